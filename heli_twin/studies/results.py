"""Results at rest: one Parquet file, one row a run, opened by DuckDB, polars, pandas and by the report."""

from collections.abc import Iterable, Iterator
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heli_twin.studies.errors import StudyError
from heli_twin.studies.store import Store

if TYPE_CHECKING:
    import pyarrow as pa

RESULTS = "results.parquet"
ROWS_A_GROUP = 50_000
TEXTS = ("id", "outcome", "outcome_text", "alternative")
"""Columns that are text even where every row lacks them."""


def write_parquet(store: Store, path: Path) -> None:
    """Write all rows in the order of the study, with one schema, by tmp and rename."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.unify_schemas(_schemas(store), promote_options="permissive")
    schema = pa.schema([pa.field(f.name, pa.string() if pa.types.is_null(f.type) else f.type) for f in schema])
    part = path.with_name(path.name + ".part")
    with pq.ParquetWriter(part, schema, compression="zstd") as writer:
        for block in _blocks(store.lines()):
            writer.write_table(_table(block, schema), row_group_size=ROWS_A_GROUP)
    part.replace(path)


def _schemas(store: Store) -> "list[pa.Schema]":
    """What columns there are, block by block: later flights may have columns that the first have not."""
    import pyarrow as pa

    always = pa.schema([pa.field(name, pa.string()) for name in TEXTS])
    return [always, *(_table(block).schema for block in _blocks(store.lines()))]


def _table(block: list[str], schema: "pa.Schema | None" = None) -> "pa.Table":
    from pyarrow import json

    data = "\n".join(block).encode()
    options = json.ParseOptions(explicit_schema=schema, unexpected_field_behavior="ignore" if schema else "infer")
    # A row has to fit into one of the reader's blocks.
    return json.read_json(BytesIO(data), json.ReadOptions(block_size=1 << 22), options)


def _blocks(lines: Iterable[str]) -> Iterator[list[str]]:
    lines = iter(lines)
    while block := list(islice(lines, ROWS_A_GROUP)):
        yield block


def read_results(folder: Path, columns: list[str] | None = None) -> "pa.Table":
    """The rows of a study's folder; of one that is still running, what there is so far.

    Args:
        folder: Of the study.
        columns: Only these, where they exist; None for all.

    Raises:
        StudyError: There are none.
    """
    import pyarrow.parquet as pq

    path = folder / RESULTS
    with Store(folder) as store:
        if not path.exists() or "finished" not in store.about():
            if next(store.lines(), None) is None:
                raise StudyError(f"no flight of {folder} is over yet: run the study first")
            path = folder / "results-so-far.parquet"
            write_parquet(store, path)
    if columns is None:
        return pq.read_table(path)
    there = pq.read_schema(path).names
    return pq.read_table(path, columns=[name for name in columns if name in there])


def rows_of(folder: Path) -> list[dict[str, Any]]:
    """The rows of a study's folder as plain values."""
    return read_results(folder).to_pylist()
