"""The SQLite file of a study: opened for writing or reading, locked, and its errors as sentences."""

import errno
import os
import sqlite3
from pathlib import Path
from urllib.parse import quote

from heli_twin.studies.errors import StudyError
from heli_twin.terminal_text import pasteable

LOCK_TIMEOUT_S = 0.2
CANNOT_WRITE = {
    *(errno.ENOSPC, errno.EFBIG, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM),
    *(errno.EISDIR, errno.ENOTDIR, errno.EEXIST, errno.ENAMETOOLONG),
}
"""Numbers of the errors of the file system that the user can mend."""
FULL_DISK = ("full", "disk i/o error")
"""Parts of SQLite's messages when it cannot write any more."""


def open_database(path: Path, *, write: bool) -> sqlite3.Connection:
    """Open the file; for reading it has to exist.

    A file that may not be written, on read-only media for one, is read as it is.
    """
    if write:
        return sqlite3.connect(path, isolation_level=None)
    if not path.exists():
        raise no_study(path.parent)
    if os.access(path.parent, os.W_OK) and os.access(path, os.W_OK):
        return sqlite3.connect(path, isolation_level=None)
    if path.with_name(f"{path.name}-wal").exists():
        raise StudyError(f"{path.parent} is read-only, and its study is not finished: read a copy of the folder")
    return sqlite3.connect(f"file:{quote(str(path.absolute()))}?immutable=1", uri=True, isolation_level=None)


def lock_folder(folder: Path) -> sqlite3.Connection:
    """Lock a folder; the operating system releases the lock when its holder dies, on every system alike."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = sqlite3.connect(folder / "lock.sqlite", isolation_level=None, timeout=LOCK_TIMEOUT_S)
        lock.execute("BEGIN EXCLUSIVE")
    except OSError as error:
        raise StudyError(f"cannot write to {folder} ({error.strerror}): give another --out") from None
    except sqlite3.Error as error:
        if getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_BUSY:
            raise StudyError(f"another study is running in {folder}: wait for it, or give another --out") from None
        raise StudyError(f"cannot lock {folder / 'lock.sqlite'} ({error}): give another --out") from None
    return lock


def no_study(folder: Path) -> StudyError:
    """The error of a folder without results."""
    again = pasteable("heli-twin", "study", "run", "FILE", "--out", folder)
    return StudyError(f"{folder} holds no study: run one with `{again}`")


def damaged_store(path: Path) -> StudyError:
    """The error of a store whose content cannot be what was written."""
    return StudyError(f"{path} is damaged: move it away, or give another --out")


def database_trouble(path: Path, error: Exception) -> StudyError:
    """The sentence for an error of SQLite or of the file system while a study's folder is used."""
    if isinstance(error, OSError):
        return StudyError(
            f"cannot write {error.filename or path.parent} ({error.strerror or error}): what was flown before is kept;"
            " mend that, and run the same command again"
        )
    if any(words in str(error).lower() for words in FULL_DISK):
        return StudyError(
            f"cannot write {path} ({error}): what was flown before is kept; free some space, and run the same command"
            " again"
        )
    if getattr(error, "sqlite_errorcode", None) in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return StudyError(f"{path} is in use by another program: wait for it, or give another --out")
    return StudyError(f"{path} cannot be used ({error}): move it away, or give another --out")


class Transaction:
    """All or nothing."""

    def __init__(self, db: sqlite3.Connection) -> None:
        self._db = db

    def __enter__(self) -> None:
        self._db.execute("BEGIN")

    def __exit__(self, kind: object, *error: object) -> None:
        if kind is None:
            self._db.execute("COMMIT")
        elif self._db.in_transaction:
            # SQLite has rolled back by itself where the disk is full.
            self._db.execute("ROLLBACK")
