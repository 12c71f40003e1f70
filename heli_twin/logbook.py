"""The start of every log (experiment, provenance), and the experiment read back from a log."""

import os
import platform
import re
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_info

from controllers.laws import extra_states
from controllers.proxqp import BUILD
from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.named_classes import origin_of, source_of
from heli_twin.experiment.own import OWN, ClassMissing, other_program, other_sources, own_classes
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
from heli_twin.terminal_text import clean
from heli_twin.whole_file import whole_file

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
            # To parse the whole of the metadata, the package's own page too, takes as long as half a second of flight.
            found = re.search(r"^Version: *(\S+)", distribution(package).read_text("METADATA") or "", re.MULTILINE)
            versions[f"version.{package}"] = found[1] if found else "unknown"
        except PackageNotFoundError:
            versions[f"version.{package}"] = "not installed"
    return versions


@cache
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
    sources: Sequence[Attachment] = (),
    listeners: Sequence[Listener] = (),
) -> Recorder:
    """Open a log and write what every log begins with: the experiment and its provenance.

    Args:
        path: Path of the finished log, `.../NAME.mcap`; None keeps it in memory.
        experiment: The experiment that is flown.
        metadata: Facts beside `provenance`, such as the origin of the log.
        mjcf: The simulated plant as MJCF; empty if there is none.
        sources: Sources of classes of the user's own, as `own_source` gives them.
        listeners: Called with every message.

    Raises:
        LogError: The file exists already or cannot be written.
    """
    attachments = [Attachment("experiment.toml", "application/toml", toml_of(experiment).encode()), *sources]
    if mjcf:
        attachments.append(Attachment("plant.xml", "application/xml", mjcf.encode()))
    return Recorder(
        path,
        experiment=canonical_json(experiment),
        metadata=provenance() | facts_of(experiment) | dict(metadata or {}),
        attachments=attachments,
        listeners=listeners,
        shape=shape_of(experiment.plant),
    )


def facts_of(experiment: Experiment) -> dict[str, str]:
    """For the log's metadata: where classes of a user's own come from, and names of further states."""
    return _own_origins(experiment) | _extra_states(experiment)


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
        ExperimentError: This version cannot fly it, or it is of several helicopters.
    """
    _require_one(log)
    try:
        return from_json(log.experiment)
    except ClassMissing as error:
        origins = dict.fromkeys(clean(text, 60) for key, text in log.metadata.items() if key.startswith("own."))
        came_from = ", ".join(origins)
        raise ClassMissing(f"{error}" + (f"; what was flown came from {came_from}" * bool(came_from))[:150]) from None
    except ExperimentError as error:
        raise ExperimentError(f"the log's experiment is none of this version of heli_twin: {error}") from None


def _require_one(log: Log) -> None:
    if log.ships:
        first = next(iter(log.ships))
        raise ExperimentError(
            f"the log is of several helicopters, {clean(', '.join(log.ships), 120)}: name one of them, as"
            f" RUN.mcap#{first}"
        )


def viewed_experiment(log: Log) -> Experiment:
    """The experiment of a log for the eye: what a class of a user's own stands for is a member of ours.

    Of its controller the period and the believed model are kept, so that limits and deadlines are right.

    Raises:
        ExperimentError: The text is not an experiment that this version knows, or of several helicopters.
    """
    _require_one(log)
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
    if log.ships:
        return list(dict.fromkeys(notice for name in log.ships for notice in own_notices(log.ship(name))))
    tree = parsed(log.experiment)
    return [*other_sources(tree), *other_program(tree, flown_experiment(log))]


def _own_origins(experiment: Experiment) -> dict[str, str]:
    """For the log's metadata: the file name, import path or package of each class of a user's own."""
    return {f"own.{path}.{spec.__name__}": origin_of(spec) for path, spec in own_classes(experiment)}


SOURCES = "own_source/"
"""Begin of the names of attachments that hold the source of a class of a user's own."""


def own_source(experiment: Experiment) -> list[Attachment]:
    """The sources of the classes of a user's own in an experiment, as attachments of its log; nothing executes them.

    Raises:
        ExperimentError: There is no such class, or one has no file with its source.
    """
    sources: dict[str, bytes] = {}
    for path, spec in own_classes(experiment):
        source, name = source_of(spec), f"{SOURCES}{spec.__name__}.py"
        # Two classes of different files may have one name.
        is_same = sources.setdefault(name, source) == source
        sources[name if is_same else f"{SOURCES}{spec.__name__}_{path.replace('.', '_')}.py"] = source
        if not source:
            raise ExperimentError(f"{path} is of the class {spec.__name__}, which has no file with its source to embed")
    if not sources:
        raise ExperimentError("there is no source to embed: every part of this experiment is heli_twin's own")
    return [Attachment(name, "text/x-python", data) for name, data in sources.items()]


def write_own_source(log: Log, folder: Path, *, force: bool = False) -> list[Path]:
    """Write the embedded sources of a log to a folder, all or none; nothing executes them.

    Raises:
        HeliTwinError: The log has none, a file exists already or cannot be written.
    """
    names = {name: name.removeprefix(SOURCES) for name in log.attachments if name.startswith(SOURCES)}
    files = {
        folder / short: log.attachments[name].data for name, short in names.items() if _CLASS_FILE.fullmatch(short)
    }
    if not files:
        raise HeliTwinError("the log has no embedded source: only a flight with --embed-source keeps it")
    present = next((path for path in files if path.exists()), None)
    if present is not None and not force:
        raise HeliTwinError(f"{present} exists already: choose another folder, or replace it with --force")
    try:
        with ExitStack() as all_or_none:
            for path, data in files.items():
                all_or_none.enter_context(whole_file(path)).write_bytes(data)
    except OSError as error:
        raise HeliTwinError(f"{folder} cannot be written: {error.strerror or error}") from None
    return [*files]


_CLASS_FILE = re.compile(r"[A-Za-z_]\w{0,99}\.py", re.ASCII)
"""A name of a file that a foreign log may give: without a folder in it."""


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
