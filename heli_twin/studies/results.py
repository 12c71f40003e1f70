"""Results of a finished study: one Parquet file with a row for each run, for DuckDB, polars, pandas and the report."""

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heli_twin.studies.database import damaged_store
from heli_twin.studies.errors import StudyError
from heli_twin.studies.store import Store
from heli_twin.whole_file import whole_file

if TYPE_CHECKING:
    import pyarrow as pa

RESULTS = "results.parquet"
ROWS_PER_GROUP = 50_000


def write_parquet(store: Store, path: Path) -> None:
    """Write all rows in the order of the study, with one schema; the file is whole or absent."""
    with whole_file(path) as part:
        _write_rows(store, part)


def _write_rows(store: Store, where: Path | BytesIO) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    kinds = {"INTEGER": pa.int64(), "REAL": pa.float64(), "TEXT": pa.string()}
    schema = pa.schema(
        [
            pa.field(name, kinds.get(kind, pa.string()), metadata=_unit(name) if kind != "TEXT" else None)
            for name, kind in store.columns().items()
        ]
    )
    with pq.ParquetWriter(where, schema, compression="zstd") as writer:
        for block in store.blocks(ROWS_PER_GROUP):
            try:
                columns = [pa.array(column, f.type) for column, f in zip(zip(*block, strict=True), schema, strict=True)]
            except pa.ArrowException:
                raise damaged_store(store.path) from None
            writer.write_table(pa.Table.from_arrays(columns, schema=schema), row_group_size=ROWS_PER_GROUP)


def _unit(column: str) -> dict[str, str] | None:
    """The unit of a column as Arrow's metadata."""
    from heli_twin.reporting.words import si_unit

    unit = si_unit(column)
    return {"unit": unit} if unit else None


def read_results(folder: Path, columns: list[str] | None = None) -> "pa.Table":
    """The rows of a study's folder; of one that is still running, what there is so far.

    Args:
        folder: Of the study; nothing is written there.
        columns: Only these, where they exist; None for all.

    Raises:
        StudyError: There are none.
    """
    with Store(folder) as store:
        table = _finished(folder / RESULTS, columns) if "finished" in store.about() else None
        if table is None:
            if next(store.rows(), None) is None:
                raise StudyError(f"no flight of {folder} is over yet: run the study first")
            rows = BytesIO()
            _write_rows(store, rows)
            rows.seek(0)
            table = _read(rows, columns)
    return table


def _finished(path: Path, columns: list[str] | None) -> "pa.Table | None":
    """The rows of a finished study's Parquet file; None if it is absent or damaged, since the store has them too."""
    from pyarrow import ArrowException

    try:
        return _read(path, columns)
    except (ArrowException, OSError):
        return None


def _read(where: Path | BytesIO, columns: list[str] | None) -> "pa.Table":
    import pyarrow.parquet as pq

    file = pq.ParquetFile(where)
    there = file.schema_arrow.names
    return file.read(there if columns is None else [name for name in columns if name in there])


def rows_of(folder: Path) -> list[dict[str, Any]]:
    """The rows of a study's folder as plain values."""
    return read_results(folder).to_pylist()
