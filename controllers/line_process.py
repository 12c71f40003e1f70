"""A process of which lines are asked: a line to its standard input, a line back from its standard output."""

import os
import select
import signal
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from shutil import which
from time import monotonic

MAX_LINE_BYTES = 1000
"""Of an answer."""
KEPT_ERROR_BYTES = 4000
"""Of the end of its standard error, for the reason why it failed."""
END_TIMEOUT_S = 1.0
"""Time between the end of file on its input and its end; then it is killed."""


class ProcessFailed(Exception):
    """It died, hung or sent what is no line; the message continues "it ..."."""


class LineProcess:
    """A process of a session of its own, so that Ctrl-C in a terminal is for us alone.

    When this process ends in whatever way, the other reads the end of file, and on Linux the kernel ends it.

    Args:
        words: The program and its arguments.
        limit: Longest time for an answer, s.

    Raises:
        ProcessFailed: It cannot be started.
    """

    def __init__(self, words: Sequence[str], limit: float) -> None:
        self._limit, self._said, self._errors, self._is_stuck = limit, b"", b"", False
        pipe = subprocess.PIPE
        try:
            self._process = subprocess.Popen(
                [*_end_with_parent(), *words], stdin=pipe, stdout=pipe, stderr=pipe, bufsize=0, start_new_session=True
            )
        except OSError as error:
            raise ProcessFailed(f"it cannot be started: {error.strerror or error}") from None
        assert self._process.stdin
        assert self._process.stdout
        assert self._process.stderr
        self._in, self._out, self._err = (
            pipe.fileno() for pipe in (self._process.stdin, self._process.stdout, self._process.stderr)
        )
        os.set_blocking(self._in, False)
        self._poll = select.poll()
        self._poll.register(self._out, select.POLLIN)
        self._poll.register(self._err, select.POLLIN)

    def ask(self, line: str) -> str:
        """Send a line and return the answer, without its line break.

        Raises:
            ProcessFailed: There is none.
        """
        due = monotonic() + self._limit
        self._send(line.encode("ascii"), due)
        while b"\n" not in self._said:
            if len(self._said) > MAX_LINE_BYTES:
                raise ProcessFailed(f"it sent more than {MAX_LINE_BYTES} bytes without a line break")
            self._wait(due)
        answer, _, rest = self._said.partition(b"\n")
        self._said = rest
        if rest:
            raise ProcessFailed("it sent more than the one line that was asked for")
        if len(answer) > MAX_LINE_BYTES:
            raise ProcessFailed(f"it sent a line of more than {MAX_LINE_BYTES} bytes")
        return answer.decode("ascii", "backslashreplace")

    def _send(self, data: bytes, due: float) -> None:
        while data:
            try:
                data = data[os.write(self._in, data) :]
            except BlockingIOError:
                self._poll.register(self._in, select.POLLOUT)
                self._wait(due)
                self._poll.unregister(self._in)
            except BrokenPipeError:
                raise ProcessFailed(self._end()) from None

    def _wait(self, due: float) -> None:
        """Wait until it says something, or takes what it is sent."""
        left = due - monotonic()
        ready = dict(self._poll.poll(1000.0 * left)) if left > 0.0 else {}
        # One that never stops to talk is always ready.
        if not ready:
            self._is_stuck = True
            raise ProcessFailed(
                f"it did not answer within {self._limit:g} s: does it flush its output after each line?"
            )
        if self._err in ready:
            said = os.read(self._err, 65536)
            self._errors = (self._errors + said)[-KEPT_ERROR_BYTES:]
            if not said:
                self._poll.unregister(self._err)
        if self._out in ready:
            said = os.read(self._out, 65536)
            self._said += said
            if not said:
                raise ProcessFailed(self._end())

    def _end(self) -> str:
        """The reason of its end, once its output is closed."""
        try:
            code = self._process.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._is_stuck = True
            return "it closed its input or output and went on"
        name = next((known.name for known in signal.Signals if known == -code), f"signal {-code}")
        return f"it was ended by {name}" if code < 0 else f"it ended with exit code {code}"

    def last_words(self) -> str:
        """The last line of its standard error that is not empty, for the reason of a failure."""
        os.set_blocking(self._err, False)
        with suppress(OSError):
            # What a pipe can hold, and no more of one that never stops to talk.
            for _ in range(2):
                self._errors = (self._errors + os.read(self._err, 65536))[-KEPT_ERROR_BYTES:]
        lines = [line.strip() for line in self._errors.decode("utf-8", "replace").splitlines()]
        return next((line for line in reversed(lines) if line), "")

    def close(self) -> None:
        """End it: first by the end of file on its input, then by force, with every process of its session's group."""
        try:
            for stream in (self._process.stdin, self._process.stdout, self._process.stderr):
                if stream:
                    stream.close()
            if not self._is_stuck:
                with suppress(subprocess.TimeoutExpired):
                    self._process.wait(END_TIMEOUT_S)
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(END_TIMEOUT_S)


@cache
def _end_with_parent() -> tuple[str, ...]:
    """On Linux a command that makes the kernel end the next one with this process, even if it never reads its input."""
    command = (which("setpriv") or "setpriv", "--pdeathsig", "KILL", "--")
    with suppress(OSError, subprocess.SubprocessError):
        if subprocess.run([*command, "true"], capture_output=True, timeout=END_TIMEOUT_S, check=False).returncode == 0:
            return command
    return ()
