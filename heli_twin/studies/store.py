"""Results of a running study: SQLite in WAL mode, written by the driver alone, intact after a kill at any moment."""

import json
import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from heli_twin.studies.columns import INVALID
from heli_twin.studies.database import (
    CANNOT_WRITE,
    Transaction,
    damaged_store,
    database_trouble,
    lock_folder,
    no_study,
    open_database,
)
from heli_twin.studies.errors import StudyError
from heli_twin.studies.plan import PlannedFlight
from heli_twin.studies.wide_table import WideTable, listed

TABLES_SQL = (
    "CREATE TABLE IF NOT EXISTS about (key TEXT PRIMARY KEY, value TEXT)",
    "CREATE TABLE IF NOT EXISTS settings (setting INTEGER PRIMARY KEY, changes TEXT)",
    "CREATE TABLE IF NOT EXISTS codes (code TEXT PRIMARY KEY, files TEXT, parts TEXT)",
)
FLIGHTS_SQL = '"id" TEXT PRIMARY KEY, "outcome" TEXT, "score_" REAL, "trouble_" INTEGER, "code" TEXT'
RUNS_SQL = '"n" INTEGER PRIMARY KEY, "id" TEXT, "setting" INTEGER, "alternative" TEXT, "point" INTEGER, "seed" INTEGER'
INDEXES_SQL = ("CREATE INDEX IF NOT EXISTS scores ON flights (score_)", "CREATE INDEX IF NOT EXISTS ids ON runs (id)")
FORMAT_VERSION = 1
"""Version of the file's format; raised when older files cannot be read any more."""
ROWS_PER_READ = 1000
INTERNAL_COLUMNS = ("n", "setting", "score_", "trouble_")
"""Columns that only this module uses."""


class Store:
    """The flights of one study's folder. A flight is stored once, by its id; `runs` says which the study asks for now.

    Args:
        folder: Of the study.
        write: As its one writer; False to look while another writes.
    """

    def __init__(self, folder: Path, *, write: bool = False) -> None:
        self.path = folder / "results.sqlite"
        self._lock = lock_folder(folder) if write else None
        try:
            self._db = open_database(self.path, write=write)
            self._check_format(write)
            self._runs = WideTable(self._db, "runs", RUNS_SQL)
            self._flights = WideTable(self._db, "flights", FLIGHTS_SQL)
            if write:
                self._db.execute("PRAGMA journal_mode=WAL")
                self._db.execute("PRAGMA synchronous=NORMAL")
                self._create()
        except (sqlite3.Error, StudyError) as error:
            self.close()
            raise (database_trouble(self.path, error) if isinstance(error, sqlite3.Error) else error) from None

    def _check_format(self, write: bool) -> None:
        """Refuse a file that is neither empty nor a store of this version; one to read must not be empty."""
        (version,) = self._db.execute("PRAGMA user_version").fetchone()
        tables = {name for (name,) in self._db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if tables and version != FORMAT_VERSION:
            raise StudyError(
                f"{self.path} was written by another version or program: move it away, or give another --out"
            )
        if not write and not {"about", "runs", "flights", "settings"} <= tables:
            raise no_study(self.path.parent)

    def _create(self) -> None:
        with Transaction(self._db):
            self._db.execute(f"PRAGMA user_version={FORMAT_VERSION}")
            for sql in TABLES_SQL:
                self._db.execute(sql)
            self._runs.create()
            self._flights.create()

    def begin(self, about: Mapping[str, Any]) -> None:
        """A new launch: what it asks for is written anew, what was flown stays."""
        with Transaction(self._db):
            self._runs.renew()
            self._db.execute("DELETE FROM settings")
            self._db.execute("DELETE FROM about")
            for sql in INDEXES_SQL:
                self._db.execute(sql)
            self.note(about)
        self._setting: tuple[int, dict[str, Any]] = (-1, {})

    def note(self, about: Mapping[str, Any]) -> None:
        """Keep facts about the study as a whole."""
        self._db.executemany("REPLACE INTO about VALUES (?, ?)", [(k, json.dumps(v)) for k, v in about.items()])

    def ask(self, runs: Iterable[tuple[int, PlannedFlight]]) -> None:
        """Write down numbered runs that the study wants."""
        with Transaction(self._db):
            self._runs.put(self._asked(runs))

    def _asked(self, runs: Iterable[tuple[int, PlannedFlight]]) -> Iterator[dict[str, Any]]:
        for n, run in runs:
            number, changes = self._setting
            if changes is not run.changes or number < 0:
                # The runs of a point share their changes.
                number += 1
                self._setting = number, run.changes
                self._db.execute("INSERT INTO settings VALUES (?, ?)", (number, json.dumps(run.changes)))
            yield run.coordinates | {"n": n, "id": run.id, "setting": number}

    def add(self, rows: Iterable[tuple[Mapping[str, Any], float | None, bool]]) -> None:
        """Store flights in one transaction: the row, its score if it completed, whether it brought no row back."""
        with Transaction(self._db):
            self._flights.put({**row, "score_": score, "trouble_": trouble} for row, score, trouble in rows)

    def forget_troubles(self) -> None:
        """Let runs that were killed, hung or raised fly again."""
        self._db.execute("DELETE FROM flights WHERE trouble_")

    def forget_invalid(self) -> None:
        """Let runs fly again that say nothing about their controller."""
        self._db.execute("DELETE FROM flights WHERE outcome = ?", (INVALID,))

    def finish(self) -> None:
        """Note the end of the study, and leave one file that can be read on read-only media."""
        self.note({"finished": datetime.now(UTC).isoformat()})
        with suppress(sqlite3.OperationalError):
            # Impossible while somebody reads.
            self._db.execute("PRAGMA journal_mode=DELETE")

    def code_of(self, files: str) -> str | None:
        """Return the code hash that belongs to a hash of files, if it is known."""
        row = self._db.execute("SELECT code FROM codes WHERE files = ?", (files,)).fetchone()
        return row[0] if row else None

    def keep_code(self, code: str, files: str, parts: Mapping[str, str]) -> None:
        """Keep what a code hash stands for."""
        self._db.execute("REPLACE INTO codes VALUES (?, ?, ?)", (code, files, json.dumps(parts)))

    def parts_of(self, code: str | None) -> dict[str, str]:
        """Return the hashes that a code hash stands for; empty for code that left none."""
        row = self._db.execute("SELECT parts FROM codes WHERE code = ?", (code,)).fetchone()
        return self._parsed(row[0]) if row else {}

    def flown_by_other(self, code: str) -> dict[str, str | None]:
        """The code hashes of all stored flights that other code flew, by id; None where it left no hash."""
        if "code" not in self._flights.columns:
            return dict.fromkeys(run_id for (run_id,) in self._db.execute("SELECT id FROM flights"))
        return dict(self._db.execute("SELECT id, code FROM flights WHERE code IS NOT ?", (code,)).fetchall())

    def forget(self, ids: Iterable[str]) -> None:
        """Let flights be flown again."""
        with Transaction(self._db):
            self._db.executemany("DELETE FROM flights WHERE id = ?", ((run_id,) for run_id in ids))

    def codes(self) -> Counter[str]:
        """Numbers of the wanted flights by the hash of the code that flew them."""
        if "code" not in self._flights.columns:
            return Counter()
        query = "SELECT coalesce(code, ''), count(*) FROM runs JOIN flights USING (id) GROUP BY code"
        return Counter(dict(self._db.execute(query).fetchall()))

    def has(self, run_id: str) -> bool:
        """Return whether a run has been flown."""
        return self._db.execute("SELECT 1 FROM flights WHERE id = ?", (run_id,)).fetchone() is not None

    def about(self) -> dict[str, Any]:
        """Facts about the study as a whole.

        Raises:
            StudyError: There are none yet.
        """
        about = {key: self._parsed(value) for key, value in self._db.execute("SELECT key, value FROM about")}
        if not {"study", "base"} <= about.keys():
            raise no_study(self.path.parent)
        return about

    def outcomes(self) -> Counter[str]:
        """Numbers of the wanted runs by outcome, so far."""
        counts = self._db.execute(
            "SELECT outcome, count(*) FROM runs JOIN flights USING (id) GROUP BY outcome ORDER BY outcome"
        )
        return Counter(dict(counts.fetchall()))

    def worst(self, number: int) -> list[tuple[str, float]]:
        """Ids and scores of the worst that completed."""
        query = (
            "SELECT DISTINCT id, score_ FROM flights JOIN runs USING (id) "
            "WHERE score_ NOT NULL ORDER BY score_ DESC, id LIMIT ?"
        )
        return self._db.execute(query, (number,)).fetchall()

    def failed(self, number: int) -> list[str]:
        """Ids of the first flights that failed."""
        query = (
            "SELECT DISTINCT id FROM runs JOIN flights USING (id) "
            "WHERE outcome NOT IN ('completed', ?) ORDER BY n LIMIT ?"
        )
        return [run_id for (run_id,) in self._db.execute(query, (INVALID, number))]

    def every(self, stride: int) -> set[str]:
        """Ids of the sampled runs: one of each `stride`."""
        query = "SELECT id FROM runs WHERE n % ? = ?"
        return {run_id for (run_id,) in self._db.execute(query, (stride, stride // 2))}

    def find(self, start: str) -> tuple[str, dict[str, Any]] | None:
        """The run whose id begins so: its id and its changes of the base, the seed among them."""
        join = "runs JOIN settings USING (setting)"
        query = f"SELECT id, changes, seed FROM {join} WHERE id >= ? AND id < ? ORDER BY id LIMIT 1"
        run = self._db.execute(query, (start, start + "~")).fetchone()
        return (run[0], self._parsed(run[1]) | {"seed": run[2]}) if run else None

    def row(self, run_id: str) -> dict[str, Any]:
        """The row of one flown run."""
        (n,) = self._db.execute("SELECT min(n) FROM runs WHERE id = ?", (run_id,)).fetchone()
        row = next(self.rows(n, n), None) if n is not None else None
        if row is None:
            raise damaged_store(self.path)
        return row

    def columns(self) -> dict[str, str]:
        """The columns of a row and their SQL types: where in the study, and then the flight."""
        self._runs.read()
        self._flights.read()
        both = self._runs.columns | {k: v for k, v in self._flights.columns.items() if k not in self._runs.columns}
        return {name: kind for name, kind in both.items() if name not in INTERNAL_COLUMNS}

    def rows(self, first: int = 0, last: int = 2**62) -> Iterator[dict[str, Any]]:
        """Rows of the runs numbered first to last that have been flown; what a row lacks is left out."""
        names = list(self.columns())
        for block in self.blocks(ROWS_PER_READ, first, last):
            for row in block:
                yield {name: value for name, value in zip(names, row, strict=True) if value is not None}

    def blocks(self, size: int, first: int = 0, last: int = 2**62) -> Iterator[list[tuple[Any, ...]]]:
        """The same as tuples, in blocks, in the order of `columns`."""
        names = self.columns()
        mine = [name for name in names if name in self._runs.columns]
        chosen = ", ".join(
            filter(None, (listed(mine, "runs."), listed([n for n in names if n not in mine], "flights.")))
        )
        # The study's order decides, not the order of flying.
        query = (
            f"SELECT {chosen} FROM runs CROSS JOIN flights ON runs.id = flights.id WHERE n BETWEEN ? AND ? ORDER BY n"
        )
        cursor = self._db.execute(query, (first, last))
        while block := cursor.fetchmany(size):
            yield block

    def _parsed(self, text: Any) -> Any:
        try:
            return json.loads(text)
        except (TypeError, ValueError):
            raise damaged_store(self.path) from None

    def close(self) -> None:
        """Close the database and release the lock."""
        for connection in (getattr(self, "_db", None), self._lock):
            if connection is not None:
                with suppress(sqlite3.Error):
                    connection.close()

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, kind: object, error: object, *trace: object) -> None:
        self.close()
        if isinstance(error, sqlite3.Error) or (isinstance(error, OSError) and error.errno in CANNOT_WRITE):
            raise database_trouble(self.path, error) from None
