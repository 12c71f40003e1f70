"""The start of every log (experiment, provenance), and the experiment read back from a log."""

import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_info

from controllers.laws import extra_states
from controllers.proxqp import BUILD
from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.families import HELI_TWIN, origin_of
from heli_twin.experiment.own import OWN, other_program, other_sources
from heli_twin.experiment.past import PHYSICS_VERSION, UNRECORDED_VERSION
from heli_twin.experiment.tree import (
    ExperimentError,
    canonical_json,
    experiment_of,
    from_json,
    parsed,
    toml_of,
    tree_of,
)
from heli_twin.lab.plant.airframe import shape_of
from heli_twin.recording import Attachment, Log, Recorder
from heli_twin.recording.state_names import EXTRA_STATES, names_of
from heli_twin.recording.writer import Listener

LOGGED_PACKAGES = ("heli-twin", "mujoco", "numpy", "proxsuite", "mcap", "rerun-sdk", "pydantic")
"""Packages whose versions are in every log."""
PHYSICS = "physics"
"""Metadata that says the physics version of the flight."""
MAX_PATH_POINTS = 600
"""Most points of the drawn reference path."""


def provenance() -> dict[str, str]:
    """Time, host and package versions of a flight; none of them determines the flight."""
    facts = {
        "started": datetime.now(UTC).isoformat(),
        PHYSICS: str(PHYSICS_VERSION),
        "python": platform.python_version(),
        "platform": platform.platform(),
    }
    facts["cpu"] = _cpu()
    facts["vectors"] = _vectors()
    facts["proxsuite_build"] = BUILD
    facts["processes"] = str(os.cpu_count())
    facts["git_commit"] = _git_commit()
    return facts | _versions()


@cache
def _versions() -> dict[str, str]:
    """The versions of the packages; looking them up takes as long as a fast flight of a second."""
    versions: dict[str, str] = {}
    for package in LOGGED_PACKAGES:
        try:
            versions[f"version.{package}"] = version(package)
        except PackageNotFoundError:
            versions[f"version.{package}"] = "not installed"
    return versions


def _cpu() -> str:
    """The processor's name: last digits differ between vector instruction sets."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(": ")[2] for line in lines if line.startswith("model name")), platform.processor())


@cache
def _vectors() -> str:
    """The vector instructions that NumPy and its BLAS use here: last digits depend on them."""
    libraries = [lib for lib in threadpool_info() if lib["user_api"] == "blas"]
    blas = {f"{lib['internal_api']} {lib.get('architecture')}" for lib in libraries}
    numpy: Any = np.show_config(mode="dicts")
    return ", ".join([*numpy["SIMD Extensions"]["found"], *sorted(blas)])


@cache
def _git_commit() -> str:
    """The commit of the checkout this package runs from; empty outside one."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=40", "--match="]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=5, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""


def begin_log(
    path: Path | None,
    experiment: Experiment,
    *,
    metadata: Mapping[str, str] | None = None,
    mjcf: str = "",
    listeners: Sequence[Listener] = (),
) -> Recorder:
    """Open a log and write what every log begins with: the experiment and its provenance.

    Args:
        path: Path of the finished log, `.../NAME.mcap`; None keeps it in memory.
        experiment: The experiment that is flown.
        metadata: Facts beside `provenance`, such as the origin of the log.
        mjcf: The simulated plant as MJCF; empty if there is none.
        listeners: Called with every message.

    Raises:
        LogError: The file exists already or cannot be written.
    """
    attachments = [Attachment("experiment.toml", "application/toml", toml_of(experiment).encode())]
    if mjcf:
        attachments.append(Attachment("plant.xml", "application/xml", mjcf.encode()))
    return Recorder(
        path,
        experiment=canonical_json(experiment),
        metadata=provenance() | _own_origins(experiment) | _extra_states(experiment) | dict(metadata or {}),
        attachments=attachments,
        listeners=listeners,
        shape=shape_of(experiment.plant),
    )


def _extra_states(experiment: Experiment) -> dict[str, str]:
    """For the log's metadata: names and units of the further states of the estimates and plans, if there are any."""
    specs = zip(EXTRA_STATES.values(), (experiment.estimator, experiment.controller), strict=True)
    return {key: names_of(states) for key, spec in specs if (states := extra_states(spec))}


def planned_path(experiment: Experiment) -> Array:
    """Points (n, 3) of the reference path, world, m, for pictures."""
    count = min(MAX_PATH_POINTS, 1 + round(experiment.duration / experiment.controller.period))
    return experiment.trajectory.flat(np.linspace(0.0, experiment.duration, count)).z[:, :3]


def flown_experiment(log: Log) -> Experiment:
    """The experiment of a log.

    Raises:
        ExperimentError: This version cannot fly it.
    """
    try:
        return from_json(log.experiment)
    except ExperimentError as error:
        raise ExperimentError(f"the log's experiment is none of this version of heli_twin: {error}") from None


def viewed_experiment(log: Log) -> Experiment:
    """The experiment of a log for the eye: what a class of a user's own stands for is a member of ours.

    Of its controller the period and the believed model are kept, so that limits and deadlines are right.

    Raises:
        ExperimentError: The text is not an experiment that this version knows.
    """
    tree = parsed(log.experiment)
    ours = tree_of(Experiment())
    for name, table in tree.items():
        if isinstance(table, dict) and OWN in table:
            kept = {key: table[key] for key in ("period", "model") if key in table and key in ours[name]}
            tree[name] = ours[name] | kept
        elif isinstance(table, dict) and name in ("disturbances", "faults"):
            tree[name] = {key: part for key, part in table.items() if not (isinstance(part, dict) and OWN in part)}
    return experiment_of(tree)


def own_notices(log: Log) -> list[str]:
    """A sentence for each class or program of a user's own that is here with another content than the logged one.

    Raises:
        ExperimentError: The text is not an experiment.
    """
    tree = parsed(log.experiment)
    return [*other_sources(tree), *other_program(tree, flown_experiment(log))]


def _own_origins(experiment: Experiment) -> dict[str, str]:
    """For the log's metadata: the file name, import path or package of each class of a user's own."""
    origins: dict[str, str] = {}
    for name in GROUPED_FIELDS:
        parts = getattr(experiment, name)
        for part in parts if isinstance(parts, tuple) else (parts,):
            spec = type(getattr(part, "member", part))
            if (origin := origin_of(spec)) != HELI_TWIN:
                origins[f"own.{name}.{spec.__name__}"] = origin
    return origins


GROUPED_FIELDS = (
    *("trajectory", "controller", "estimator", "supervisor", "excitation", "plant", "disturbances", "faults"),
)
"""Parts of an experiment that may be of a class of a user's own."""


def physics_version(log: Log) -> int:
    """The physics version that a log was flown with; 3 for a log that does not say it.

    Raises:
        HeliTwinError: It is not a version.
    """
    version = log.metadata.get(PHYSICS, str(UNRECORDED_VERSION))
    if not (version.isascii() and version.isdecimal() and len(version) < 5):
        raise HeliTwinError(f"the log says physics = {version[:20]!r}, which is not a version of the physics")
    return int(version)


def physics_notice(log: Log) -> str:
    """A sentence for a log of another physics version, to print before it is flown again; empty for one of today's."""
    version = physics_version(log)
    if version == PHYSICS_VERSION:
        return ""
    return (
        f"the log was flown with physics version {version}, this is version {PHYSICS_VERSION}: the same experiment"
        " flies differently, so the flights need not be identical"
    )
