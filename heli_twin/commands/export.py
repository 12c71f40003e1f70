"""`heli-twin export`: a log as Parquet files."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path

from heli_twin.commands import command, file_path, say


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "export",
        run,
        "write a log as Parquet files, one a topic",
        "Write a log as Parquet files that Polars, DuckDB and pandas read, one a topic.",
        "  heli-twin export logs/RUN.mcap --parquet tables\n"
        "  duckdb -c \"select time, position[3] as z from 'tables/truth.parquet'\"",
    )
    parser.add_argument("log", type=file_path, metavar="RUN.mcap", help="a log that heli-twin recorded")
    parser.add_argument("--parquet", type=Path, metavar="DIR", required=True, help="folder for the files")


def run(parsed: Namespace) -> int:
    """Write the files."""
    from heli_twin.exchange.arrow_tables import write_parquet
    from heli_twin.recording import read_log

    for path, rows in write_parquet(read_log(parsed.log), parsed.parquet):
        say(f"{path}: {rows} rows")
    return 0
