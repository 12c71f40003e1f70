"""A log as Arrow tables, for Polars, DuckDB, pandas and Parquet: one row per message, one typed column per field.

An Arrow column shares the memory of the log's NumPy column: no number is copied. Vectors are lists of fixed size. The
metadata of a column tell its `unit`, and in `about` its meaning and frame; those of a table what was flown.
"""

from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from heli_twin.errors import HeliTwinError
from heli_twin.recording import Log
from heli_twin.recording.schema import LATER_WIRES, WIRES
from heli_twin.recording.state_names import EXTRA_STATES
from heli_twin.recording.topics_table import fields as contract
from heli_twin.terminal_text import instead
from heli_twin.whole_file import whole_file

WIRE_NAMES = tuple(topic.name for topic in WIRES + LATER_WIRES)
"""The topics that have a table. Topic names in a file never become names of files."""


def table(log: Log, topic: str) -> pa.Table:
    """One topic of a log.

    Args:
        log: Any log.
        topic: One of `WIRE_NAMES`.

    Returns:
        One row per message, one column per field; times and stamps in ns.

    Raises:
        HeliTwinError: There is no such topic, or its messages cannot be read.
    """
    if topic not in WIRE_NAMES:
        raise HeliTwinError(f"unknown topic {instead(topic, WIRE_NAMES)}")
    columns = getattr(log, topic.rpartition("/")[2])
    if topic == "/events":
        types = {"time": pa.int64(), "severity": pa.string(), "name": pa.string(), "text": pa.string()}
        return pa.table({key: pa.array([getattr(e, key) for e in columns], kind) for key, kind in types.items()})
    about = {"topic": topic, "outcome": log.outcome, "digest": log.digest, "experiment": log.experiment}
    if topic in EXTRA_STATES:
        return _extra_table(log, topic, about)
    said = _said_of(topic)
    arrays = {name: _column(values) for name, values in columns._asdict().items()}
    fields = [pa.field(name, array.type, metadata=said.get(name)) for name, array in arrays.items()]
    return pa.table([*arrays.values()], schema=pa.schema(fields, metadata=about))


@cache
def _said_of(topic: str) -> dict[str, dict[str, str]]:
    """Unit and meaning of each column of a topic, as `flight.proto` has them."""
    message = next(t.schema_name.rpartition(".")[2] for t in WIRES + LATER_WIRES if t.name == topic)
    said = {"time": {"unit": "ns", "about": "log time, simulated"}}
    for field in contract():
        if field.message == message:
            unit = field.comment.partition(";")[0].rpartition(", ")[2]
            has_unit = {"unit": unit} if unit in UNITS else {}
            said[field.name] = {**has_unit, "about": field.comment}
    return said


UNITS = ("ns", "m", "m/s", "rad", "rad/s", "m/s^2", "V", "A", "N m", "fraction of full stick", "count")
"""Units with which a description of a field may end. A column of several quantities has theirs in the description."""


def _extra_table(log: Log, topic: str, about: dict[str, str]) -> pa.Table:
    """Further states of estimates or plans: a column for each, called by its name, with its unit in the metadata."""
    columns = {"time": _column(log.estimate_extra.time if topic == "/estimate_extra" else log.plan_extra.time)}
    units = {"time": "ns"}
    if topic == "/estimate_extra":
        columns["stamp"], units["stamp"] = _column(log.estimate_extra.stamp), "ns"
        for i, (name, unit) in enumerate(log.estimate_states):
            columns[name], units[name] = _column(log.estimate_extra.x[:, i]), unit
            columns[f"{name}_variance"] = _column(log.estimate_extra.variance[:, i])
            units[f"{name}_variance"] = f"({unit})^2"
    else:
        for i, (name, unit) in enumerate(log.plan_states):
            columns[name], units[name] = _column(log.plan_extra.x[:, :, i]), unit
    fields = [pa.field(name, values.type, metadata={"unit": units[name]}) for name, values in columns.items()]
    return pa.table([*columns.values()], schema=pa.schema(fields, metadata=about))


def tables(log: Log) -> dict[str, pa.Table]:
    """Every topic of a log that has messages."""
    return {topic: table(log, topic) for topic in WIRE_NAMES if len(log.messages.get(topic, ((),))[0])}


def _column(values: np.ndarray[Any, Any]) -> pa.Array:
    """An Arrow column from values (n, ...), without copying numbers."""
    if values.dtype.kind == "U":
        return pa.array(values.tolist(), pa.string())
    column = pa.array(np.ascontiguousarray(values).reshape(-1))
    for size in reversed(values.shape[1:]):
        column = pa.FixedSizeListArray.from_arrays(column, size)
    return column


def write_parquet(log: Log, folder: Path, *, force: bool = False) -> list[tuple[Path, int]]:
    """Write one Parquet file per topic, all of them or none; that of `/mocap/pose` is `mocap_pose.parquet`.

    Args:
        log: Any log.
        folder: For the files.
        force: Replace files that are there.

    Returns:
        Each file and its number of rows.

    Raises:
        HeliTwinError: A file exists already or cannot be written.
    """
    files = {folder / f"{topic.strip('/').replace('/', '_')}.parquet": rows for topic, rows in tables(log).items()}
    present = next((path for path in files if path.exists()), None)
    if present is not None and not force:
        raise HeliTwinError(f"{present} exists already: choose another folder, or replace it with --force")
    try:
        with ExitStack() as all_or_none:
            for path, rows in files.items():
                pq.write_table(rows, all_or_none.enter_context(whole_file(path)), compression="zstd")
    except (OSError, pa.ArrowException) as error:
        raise HeliTwinError(f"Parquet files cannot be written to {folder}: {error}") from error
    return [(path, rows.num_rows) for path, rows in files.items()]
