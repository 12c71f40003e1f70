"""Many flights as a table for Rerun, of a study or of a folder of logs: those that failed first, then the worst."""

from collections.abc import Sequence
from math import isfinite, pi
from pathlib import Path
from typing import Any

import pyarrow as pa

from heli_twin.experiment.differences import fly_words
from heli_twin.experiment.tree import ExperimentError
from heli_twin.flight import INTACT
from heli_twin.metrics.tracking import metrics
from heli_twin.mission import MEASURED
from heli_twin.recording import read_log
from heli_twin.reporting.words import field, metric
from heli_twin.studies.columns import COMPLETED, SCORED
from heli_twin.studies.errors import StudyError
from heli_twin.studies.results import read_results
from heli_twin.studies.store import Store
from heli_twin.studies.study import stored_study
from heli_twin.terminal_text import clean, pasteable
from heli_twin.viewing.flight_table import FlightTable

STORE = "results.sqlite"
"""The file that makes a folder a study's."""
PLACE = ("alternative", "rung", "varied", "found_by")
"""Columns that tell where in the study a flight is, beside its axes."""


def table_of(paths: Sequence[Path]) -> FlightTable:
    """The flights of a study, of folders with logs, or of logs.

    Raises:
        HeliTwinError: There are none, or one cannot be read.
    """
    if len(paths) == 1 and (paths[0] / STORE).exists():
        return study_table(paths[0])
    logs = [log for path in paths for log in (sorted(path.glob("*.mcap")) if path.is_dir() else [path])]
    if not logs:
        raise StudyError(f"{paths[0]} holds neither a study nor a log: give the folder of a study, or logs")
    return log_table(paths[0].name if len(paths) == 1 else "flights", logs)


def log_table(title: str, logs: Sequence[Path]) -> FlightTable:
    """One row a log: what was flown, how it ended, and its errors."""
    rows = sorted((_about(log) for log in logs), key=lambda row: (row["outcome"] in INTACT, -(row["rms, cm"] or 0.0)))
    columns = {name: [row[name] for row in rows] for name in rows[0] if name != "path"}
    return FlightTable(title, pa.table(columns), [row["path"] for row in rows])


def _about(path: Path) -> dict[str, Any]:
    log = read_log(path, MEASURED)
    try:
        words = " ".join(fly_words(log.experiment))
    except ExperimentError:
        words = "an experiment that this version does not know"
    found = metrics(log)["rmse"]
    lengths = [found[axis] for axis in "xyz"]
    position = None if None in lengths else sum(value**2 for value in lengths) ** 0.5
    return {
        "path": path,
        "outcome": log.outcome,
        "flown": clean(words, 120) or "lab",
        "rms, cm": _rounded(position, 100.0),
        **{f"rms {axis}, cm": _rounded(found[axis], 100.0) for axis in "xyz"},
        "rms yaw, deg": _rounded(found["yaw"], 180.0 / pi),
        "log": path.name,
        "how it ended": clean(log.ending.text, 120),
    }


def _rounded(value: float | None, factor: float) -> float | None:
    return None if value is None or not isfinite(value) else float(f"{factor * value:.4g}")


def study_table(folder: Path) -> FlightTable:
    """One row a run of a study: what it was, how it ended, its metrics, and the command that shows it.

    Raises:
        StudyError: There are no runs.
    """
    with Store(folder) as store:
        study = stored_study(store.about()["study"])
    shown = list(dict.fromkeys((study.score, *study.metrics)))
    rows = read_results(folder, ["id", "outcome", "outcome_text", "seed", *PLACE, *study.axes, *shown])
    rows = rows.take(pa.array(_order(rows, study.score)))
    ids: list[str] = rows.column("id").to_pylist()
    logs = [log if log.exists() else None for log in (folder / "logs" / f"{run_id}.mcap" for run_id in ids)]
    columns: dict[str, Any] = {"outcome": rows.column("outcome")}
    for name in (*PLACE, *study.axes, *shown, "seed"):
        if name in rows.column_names:
            title, values = _shown(name, rows.column(name).to_pylist(), name in shown)
            columns[name if title in columns else title] = values
    columns["how it ended"] = [clean(text or "", 120) for text in rows.column("outcome_text").to_pylist()]
    columns["command"] = [
        pasteable("heli-twin", "replay", log) if log else pasteable("heli-twin", "study", "fly", folder, run_id)
        for log, run_id in zip(logs, ids, strict=True)
    ]
    return FlightTable(study.name, pa.table(columns), logs)


def _order(rows: pa.Table, score: str) -> list[int]:
    """The places of the rows: flights that failed in the study's order, then the others from the worst score on."""
    outcomes = rows.column("outcome").to_pylist()
    scores = rows.column(score).to_pylist() if score in rows.column_names else [None] * len(outcomes)
    keys = [
        (outcome == COMPLETED, -(value or 0.0) if outcome in SCORED else 0.0)
        for outcome, value in zip(outcomes, scores, strict=True)
    ]
    return sorted(range(len(keys)), key=keys.__getitem__)


def _shown(name: str, values: list[Any], is_metric: bool) -> tuple[str, Any]:
    """A heading, short enough to be seen whole, and the values in the units that a person reads."""
    numbers = [value for value in values if isinstance(value, int | float)]
    if name == "seed":
        return name, values
    if not numbers or len(numbers) + values.count(None) < len(values):
        texts = [None if value is None else clean(value, 60) for value in values]
        return name.rpartition(".")[2], texts
    scale = metric(name) if is_metric else field(name, numbers)
    short = _short(name) if is_metric else name.rpartition(".")[2]
    heading = f"{short}, {scale.unit}" if scale.unit else short
    return heading, [_rounded(value, scale.factor) for value in values]


def _short(name: str) -> str:
    """`rms x` of `rmse.x`, `max` of `max_abs_error.position`."""
    stem, _, axis = name.partition(".")
    return f"{SHORT.get(stem, stem)} {axis if axis != 'position' else ''}".strip()


SHORT = {"rmse": "rms", "max_abs_error": "max", "p95": "95 %"}
