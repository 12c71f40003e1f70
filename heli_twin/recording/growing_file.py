"""The file of a log while it grows; if it cannot be written any more, the log goes on in memory."""

import logging
import os
from collections.abc import Callable
from contextlib import suppress
from io import BytesIO
from pathlib import Path

from heli_twin.recording.schema import LogError, LogExistsError
from heli_twin.terminal_text import pasteable
from heli_twin.whole_file import part_of

_LOGGER = logging.getLogger(__name__)


class LogFile:
    """`NAME.mcap.part` until it is finished.

    A full disk or a removed folder ends the file but not the flight: what was written stays in the `.part` file, and
    the whole log goes on in memory, so that all metrics can be computed. One warning is logged.

    Args:
        path: Path of the finished log, `.../NAME.mcap`.
        clock: Returns the simulated time, ns.

    Raises:
        LogExistsError: The name is taken, also if another process takes it at this moment.
        LogError: The file cannot be made.
    """

    def __init__(self, path: Path, clock: Callable[[], int] = lambda: 0) -> None:
        self.path, self.part = path, part_of(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _unwritable(path, error) from error
        try:
            # Unbuffered: after a failed write, the content of a buffer could not be recovered.
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
        """The whole log, once the file cannot be written any more; None before."""
        self.trouble = ""
        """The reason why there is no file, one sentence; empty while there is one."""

    def write(self, data: bytes) -> None:
        """Add bytes.

        Raises:
            LogError: The file can be neither written nor read back.
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
        """Remove the file."""
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
            # Later messages are lost too.
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
