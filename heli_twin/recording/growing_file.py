"""The file of a log while it grows, which becomes memory when the disk gives up."""

import logging
import os
from collections.abc import Callable
from contextlib import suppress
from io import BytesIO
from pathlib import Path

from heli_twin.pasteable import pasteable
from heli_twin.recording.schema import LogError, LogExistsError

_LOGGER = logging.getLogger(__name__)


class LogFile:
    """`NAME.mcap.part` until it is finished.

    A disk that is full, or a folder that is gone, ends the file and not the flight: what was written stays in the
    `.part` file, and the log goes on in memory, whole, so that the flight is measured like any other. It is told once.

    Args:
        path: Where the log shall be when the flight is over, `.../NAME.mcap`.
        clock: Tells the simulated time, ns.

    Raises:
        LogExistsError: The name is taken, also if another process takes it at this moment.
        LogError: The file cannot be made.
    """

    def __init__(self, path: Path, clock: Callable[[], int] = lambda: 0) -> None:
        self.path, self.part = path, path.with_name(path.name + ".part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _unwritable(path, error) from error
        try:
            # Unbuffered, because a buffer cannot be asked for what it could not write.
            self._file = self.part.open("x+b", buffering=0)
        except FileExistsError:
            raise _exists(self.part) from None
        except OSError as error:
            raise _unwritable(path, error) from error
        # Whoever holds the `.part` file holds the name: looked up before, another flight could take it in between.
        if os.path.lexists(path):
            self.discard()
            raise _exists(path)
        self._clock = clock
        self._size = 0
        self.memory: BytesIO | None = None
        """The whole log, once the disk has given up."""
        self.trouble = ""
        """Why there is no file; one sentence."""

    def write(self, data: bytes) -> None:
        """Add bytes.

        Raises:
            LogError: The disk gave up so badly that what it holds cannot be read either.
        """
        if self.memory is None:
            try:
                self._write(data)
                return
            except OSError as error:
                self._give_up(error)
        assert self.memory is not None
        self.memory.write(data)

    def finish(self) -> None:
        """Give the file its name."""
        if self.memory is not None:
            return
        try:
            os.fsync(self._file.fileno())
            self.part.rename(self.path)
            self._file.close()
        except OSError as error:
            self._give_up(error)

    def discard(self) -> None:
        """Remove the file, because nothing worth keeping is in it."""
        self._file.close()
        with suppress(OSError):
            self.part.unlink()

    def _write(self, data: bytes) -> None:
        left = memoryview(data)
        while left:
            left = left[self._file.write(left) :]
        self._size += len(data)

    def _give_up(self, error: OSError) -> None:
        try:
            self._file.seek(0)
            self.memory = BytesIO(self._file.read(self._size))
        except OSError as worse:
            # What the flight still has to say goes nowhere.
            self.memory = BytesIO()
            raise LogError(f"the log {self.path} is lost ({_reason(worse)}): record to another disk") from error
        finally:
            with suppress(OSError):
                self._file.close()
        self.memory.seek(0, os.SEEK_END)
        self.trouble = (
            f"the log {self.path} cannot be written any more at {1e-9 * self._clock():.2f} s ({_reason(error)}):"
            " the flight goes on without it"
        )
        if self.part.exists():
            command = pasteable("heli-twin", "recover", self.part)
            self.trouble += f"; put that right, then `{command}` keeps what was written until then"
        _LOGGER.warning("%s", self.trouble)


def _exists(path: Path) -> LogExistsError:
    return LogExistsError(f"the log {path} exists already: choose another name or move it away")


def _unwritable(path: Path, error: OSError) -> LogError:
    return LogError(f"the log {path} cannot be written ({_reason(error)}): record to another folder")


def _reason(error: OSError) -> str:
    return error.strerror or str(error)
