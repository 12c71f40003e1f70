"""An SQLite table that grows a column when a row brings one it has not seen."""

import sqlite3
from collections.abc import Iterable, Mapping
from operator import itemgetter
from typing import Any

INTEGER_COLUMNS = {"n", "point", "replicate", "seed", "attempts", "setting", "height", "level", "sample", "trial"}
"""Columns of whole numbers; any other number is a float, so that a column has one type whatever comes first."""


class WideTable:
    """Rows by a key, a column a name.

    Args:
        db: The database.
        name: Of the table.
        key: The columns that it starts with, as SQL; the first is the primary key.
    """

    def __init__(self, db: sqlite3.Connection, name: str, key: str) -> None:
        self._db, self._name, self._key = db, name, key
        self.columns: dict[str, str] = {}
        """SQL types by name."""
        self.read()

    def create(self) -> None:
        """Make the table unless it is there."""
        self._db.execute(f"CREATE TABLE IF NOT EXISTS {self._name} ({self._key})")
        self.read()

    def renew(self) -> None:
        """Delete all rows and columns."""
        self._db.execute(f"DROP TABLE IF EXISTS {self._name}")
        self.create()

    def read(self) -> None:
        """Read which columns there are."""
        info = self._db.execute(f"PRAGMA table_info({self._name})").fetchall()
        self.columns = {name: kind for _, name, kind, *_ in info}

    def put(self, rows: Iterable[Mapping[str, Any]]) -> None:
        """Add rows, or replace those with the same key; what a row lacks is null."""
        batch: list[Mapping[str, Any]] = []
        for row in rows:
            if not row.keys() <= self.columns.keys():
                self._insert(batch)
                batch = []
                for name in row.keys() - self.columns.keys():
                    self._grow(name, row[name])
            batch.append(row)
        self._insert(batch)

    def _insert(self, rows: list[Mapping[str, Any]]) -> None:
        names = list(self.columns)
        places = ", ".join("?" * len(names))
        whole = itemgetter(*names)
        values = (whole(row) if len(row) == len(names) else [row.get(name) for name in names] for row in rows)
        self._db.executemany(f"REPLACE INTO {self._name} ({listed(names)}) VALUES ({places})", values)

    def _grow(self, name: str, value: Any) -> None:
        kind = "INTEGER" if name in INTEGER_COLUMNS else "TEXT" if isinstance(value, str) else "REAL"
        self._db.execute(f"ALTER TABLE {self._name} ADD COLUMN {quoted(name)} {kind}")
        self.columns[name] = kind


def quoted(name: str) -> str:
    """A column's name in SQL."""
    return '"' + name.replace('"', '""') + '"'


def listed(names: Iterable[str], table: str = "") -> str:
    """Columns in SQL."""
    return ", ".join(f"{table}{quoted(name)}" for name in names)
