"""Results while a study runs: SQLite in WAL mode, written by the driver alone, whole after a kill at any moment."""

import json
import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from heli_twin.studies.errors import StudyError
from heli_twin.studies.plan import Run

SCHEMA = """
CREATE TABLE IF NOT EXISTS about (key TEXT PRIMARY KEY, value TEXT);
CREATE TABLE IF NOT EXISTS flights (id TEXT PRIMARY KEY, outcome TEXT, score REAL, trouble INTEGER, row TEXT);
CREATE INDEX IF NOT EXISTS scores ON flights (score);
CREATE TABLE IF NOT EXISTS runs (n INTEGER PRIMARY KEY, id TEXT, coordinates TEXT, changes TEXT);
CREATE INDEX IF NOT EXISTS ids ON runs (id);
"""


class Store:
    """The flights of one study's folder. A flight is stored once, by its id; `runs` says which the study asks for now.

    Args:
        folder: Of the study.
        write: As its one writer; False to look while another writes.
    """

    def __init__(self, folder: Path, *, write: bool = False) -> None:
        self.path = folder / "results.sqlite"
        if not write and not self.path.exists():
            raise StudyError(f"{folder} holds no study: run one with `heli-twin study run FILE --out {folder}`")
        self._lock = _lock(folder) if write else None
        try:
            self._db = sqlite3.connect(self.path, isolation_level=None)
            if write:
                self._db.execute("PRAGMA journal_mode=WAL")
                self._db.execute("PRAGMA synchronous=NORMAL")
                self._db.executescript(SCHEMA)
        except sqlite3.DatabaseError as error:
            raise StudyError(f"{self.path} cannot be used ({error}): move it away, or give another --out") from None

    def begin(self, about: Mapping[str, Any]) -> None:
        """A new launch: what it asks for is written anew, what was flown stays."""
        with self._transaction():
            self._db.execute("DELETE FROM runs")
            self._db.execute("DELETE FROM about")
            self.note(about)

    def note(self, about: Mapping[str, Any]) -> None:
        """Keep facts about the study as a whole."""
        self._db.executemany("REPLACE INTO about VALUES (?, ?)", [(k, json.dumps(v)) for k, v in about.items()])

    def ask(self, runs: Iterable[tuple[int, Run]]) -> None:
        """Write down numbered runs that the study wants."""
        rows = ((n, run.id, json.dumps(run.coordinates), json.dumps(run.changes)) for n, run in runs)
        with self._transaction():
            self._db.executemany("REPLACE INTO runs VALUES (?, ?, ?, ?)", rows)

    def add(self, rows: Iterable[tuple[Mapping[str, Any], float | None, bool]]) -> None:
        """Store flights in one transaction: the row, its score if it completed, whether it brought no row back."""
        with self._transaction():
            self._db.executemany(
                "REPLACE INTO flights VALUES (?, ?, ?, ?, ?)",
                ((row["id"], row["outcome"], score, trouble, json.dumps(row)) for row, score, trouble in rows),
            )

    def forget_troubles(self) -> None:
        """Let runs that were killed, hung or raised fly again."""
        self._db.execute("DELETE FROM flights WHERE trouble")

    def has(self, run_id: str) -> bool:
        """Whether a run has been flown."""
        return self._db.execute("SELECT 1 FROM flights WHERE id = ?", (run_id,)).fetchone() is not None

    def about(self) -> dict[str, Any]:
        """Facts about the study as a whole."""
        return {key: json.loads(value) for key, value in self._db.execute("SELECT key, value FROM about")}

    def outcomes(self) -> Counter[str]:
        """How the runs that the study wants have ended so far."""
        found = self._db.execute(
            "SELECT outcome, count(*) FROM runs JOIN flights USING (id) GROUP BY outcome ORDER BY outcome"
        )
        return Counter(dict(found.fetchall()))

    def worst(self, number: int) -> list[tuple[str, float]]:
        """Ids and scores of the worst that completed."""
        query = "SELECT DISTINCT id, score FROM runs JOIN flights USING (id) WHERE score NOT NULL ORDER BY score DESC, id LIMIT ?"
        return self._db.execute(query, (number,)).fetchall()

    def failed(self, number: int) -> list[str]:
        """Ids of the first flights that failed."""
        query = "SELECT DISTINCT id FROM runs JOIN flights USING (id) WHERE outcome != 'completed' ORDER BY n LIMIT ?"
        return [found for (found,) in self._db.execute(query, (number,))]

    def every(self, stride: int) -> set[str]:
        """Ids of the sampled runs: one of each `stride`."""
        query = "SELECT id FROM runs WHERE n % ? = ?"
        return {found for (found,) in self._db.execute(query, (stride, stride // 2))}

    def find(self, start: str) -> tuple[str, dict[str, Any]] | None:
        """The run whose id begins so: its id and its changes of the base."""
        query = "SELECT id, changes FROM runs WHERE substr(id, 1, ?) = ? LIMIT 1"
        found = self._db.execute(query, (len(start), start)).fetchone()
        return (found[0], json.loads(found[1])) if found else None

    def row(self, run_id: str) -> dict[str, Any]:
        """The row of one flown run."""
        (n,) = self._db.execute("SELECT min(n) FROM runs WHERE id = ?", (run_id,)).fetchone()
        return next(self.rows(n, n))

    def rows(self, first: int = 0, last: int = 2**62) -> Iterator[dict[str, Any]]:
        """Rows of the runs numbered first to last that have been flown: coordinates, then the flight."""
        for text in self.lines(first, last):
            yield json.loads(text)

    def lines(self, first: int = 0, last: int = 2**62) -> Iterator[str]:
        """The same as JSON texts."""
        query = (
            "SELECT substr(coordinates, 1, length(coordinates) - 1) || ', ' || substr(row, 2) "
            "FROM runs CROSS JOIN flights USING (id) WHERE n BETWEEN ? AND ? ORDER BY n"
        )
        for (text,) in self._db.execute(query, (first, last)):
            yield text

    def close(self) -> None:
        """Let go of the folder."""
        with suppress(sqlite3.Error):
            self._db.close()
        if self._lock is not None:
            self._lock.close()

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _transaction(self) -> "_Transaction":
        return _Transaction(self._db)


class _Transaction:
    """All or nothing."""

    def __init__(self, db: sqlite3.Connection) -> None:
        self._db = db

    def __enter__(self) -> None:
        self._db.execute("BEGIN")

    def __exit__(self, kind: object, *error: object) -> None:
        self._db.execute("COMMIT" if kind is None else "ROLLBACK")


def _lock(folder: Path) -> sqlite3.Connection:
    """A lock that the operating system lets go of when its holder dies, on every system alike."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = sqlite3.connect(folder / "lock.sqlite", isolation_level=None, timeout=0.2)
        lock.execute("BEGIN EXCLUSIVE")
    except sqlite3.OperationalError:
        raise StudyError(f"another study is running in {folder}: wait for it, or give another --out") from None
    except OSError as error:
        raise StudyError(f"cannot write to {folder} ({error.strerror}): give another --out") from None
    return lock
