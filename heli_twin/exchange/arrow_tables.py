"""A log as Arrow tables, for Polars, DuckDB, pandas and Parquet: one row a message, one typed column a field.

The numbers are not copied: a column of Arrow is the NumPy column of the log. Vectors are lists of fixed size.
"""

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from heli_twin.errors import HeliTwinError
from heli_twin.recording import Log

TOPICS = {
    "/truth": "truth",
    "/mocap/pose": "pose",
    "/estimate": "estimate",
    "/reference": "reference",
    "/command/sent": "sent",
    "/command/acting": "acting",
    "/mpc/plan": "plan",
    "/mpc/qp": "qp",
    "/disturbance": "disturbance",
    "/battery": "battery",
    "/events": "events",
    "/timing": "timing",
}
"""The wires and their names in a Log. A file's own topic names never name a file here."""


def table(log: Log, topic: str) -> pa.Table:
    """One topic of a log.

    Args:
        log: Any log.
        topic: One of `TOPICS`. Times and stamps are in ns, all else as in the type of that topic.

    Raises:
        HeliTwinError: There is no such topic.
    """
    if topic not in TOPICS:
        raise HeliTwinError(f"unknown topic '{topic}': available are {', '.join(TOPICS)}")
    columns = getattr(log, TOPICS[topic])
    if topic == "/events":
        types = {"time": pa.int64(), "severity": pa.string(), "name": pa.string(), "text": pa.string()}
        return pa.table({key: pa.array([getattr(e, key) for e in columns], kind) for key, kind in types.items()})
    about = {"topic": topic, "outcome": log.outcome, "digest": log.digest, "experiment": log.experiment}
    return pa.table({name: _column(values) for name, values in columns._asdict().items()}, metadata=about)


def tables(log: Log) -> dict[str, pa.Table]:
    """Every topic of a log that has messages."""
    return {topic: table(log, topic) for topic in TOPICS if len(log.messages.get(topic, ((),))[0])}


def _column(values: np.ndarray[Any, Any]) -> pa.Array:
    """A column (n, ...) without copying its numbers."""
    if values.dtype.kind == "U":
        return pa.array(values.tolist(), pa.string())
    column = pa.array(np.ascontiguousarray(values).reshape(-1))
    for size in reversed(values.shape[1:]):
        column = pa.FixedSizeListArray.from_arrays(column, size)
    return column


def write_parquet(log: Log, folder: Path) -> list[tuple[Path, int]]:
    """Write one Parquet file a topic: `/mocap/pose` is `mocap_pose.parquet`; all of them or none.

    Returns:
        Each file and its number of rows.

    Raises:
        HeliTwinError: A file exists already or cannot be written.
    """
    files = {folder / f"{topic.strip('/').replace('/', '_')}.parquet": found for topic, found in tables(log).items()}
    present = next((path for path in files if path.exists()), None)
    if present is not None:
        raise HeliTwinError(f"{present} exists already: choose another folder or move it away")
    parts = [path.with_name(f"{path.name}.part") for path in files]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for part, found in zip(parts, files.values(), strict=True):
            pq.write_table(found, part, compression="zstd")
        for part, path in zip(parts, files, strict=True):
            part.rename(path)
    except (OSError, pa.ArrowException) as error:
        raise HeliTwinError(f"Parquet files cannot be written to {folder}: {error}") from error
    finally:
        for part in parts:
            with suppress(OSError):
                part.unlink(missing_ok=True)
    return [(path, found.num_rows) for path, found in files.items()]
