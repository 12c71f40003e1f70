"""Files that a command has left under their final names."""

import sqlite3
import tomllib
from pathlib import Path

import pyarrow.parquet

from heli_twin import read_log


def check_readable(path: Path) -> None:
    """A file can be read to its end, by what reads its kind."""
    if path.suffix == ".mcap":
        assert read_log(path).ending, path
    elif path.suffix == ".toml":
        assert tomllib.loads(path.read_text()), path
    elif path.suffix == ".parquet":
        assert pyarrow.parquet.read_table(path).num_columns, path
    elif path.suffix in (".html", ".svg"):
        assert path.read_text().rstrip().endswith(("</html>", "</svg>")), path
    elif path.suffix == ".png":
        assert path.read_bytes().endswith(b"IEND\xaeB`\x82"), path
    elif path.suffix == ".sqlite":
        with sqlite3.connect(path) as store:
            assert store.execute("PRAGMA integrity_check").fetchone() == ("ok",), path
