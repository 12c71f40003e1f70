"""`heli-twin export`: a log as Parquet files, and the sources that are embedded in it."""

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
        "Write a log as Parquet files that Polars, DuckDB and pandas read, one a topic, or take out the sources that\n"
        "`heli-twin fly --embed-source` has put in: nothing executes them.",
        "  heli-twin export logs/RUN.mcap --parquet tables\n"
        "  duckdb -c \"select time, position[3] as z from 'tables/truth.parquet'\"\n"
        "  heli-twin export logs/RUN.mcap --source theirs",
    )
    parser.add_argument("log", type=file_path, metavar="RUN.mcap", help="a log that heli-twin recorded")
    parser.add_argument("--parquet", type=Path, metavar="DIR", help="folder for the tables")
    parser.add_argument("--source", type=Path, metavar="DIR", help="folder for embedded sources of somebody's classes")
    parser.add_argument("--force", action="store_true", help="replace files that are there")


def run(parsed: Namespace) -> int:
    """Write the files."""
    from heli_twin.errors import HeliTwinError
    from heli_twin.exchange.arrow_tables import write_parquet
    from heli_twin.logbook import write_own_source
    from heli_twin.recording import read_log

    if parsed.parquet is None and parsed.source is None:
        raise HeliTwinError("nothing to export: say --parquet DIR for tables, or --source DIR for embedded sources")
    log = read_log(parsed.log)
    if parsed.parquet is not None:
        for path, rows in write_parquet(log, parsed.parquet, force=parsed.force):
            say(f"{path}: {rows} rows")
    if parsed.source is not None:
        for path in write_own_source(log, parsed.source, force=parsed.force):
            say(f"{path}: read it before you run it")
    return 0
