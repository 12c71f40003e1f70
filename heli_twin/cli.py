"""The `heli-twin` command. Each subcommand is one file in `heli_twin/commands/` and is found there."""

import gc
import logging
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from io import TextIOWrapper
from types import FrameType

from heli_twin import commands
from heli_twin.errors import HeliTwinError
from heli_twin.terminal_text import clean
from heli_twin.whole_file import STOP_SIGNALS

STOP_TIMEOUT_S = 4
"""Time that a command may take to end after a signal asked it to; then the kernel ends it."""


class Stopped(KeyboardInterrupt):
    """A signal asked the command to end.

    Of the class itself Python notes that it passed through code made at run time, and ends itself by SIGINT at exit.
    """


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Without the program's name; None to be the program: read `sys.argv`, and take over what belongs to
            the process (signals, logging, closed streams).

    Returns:
        The exit code: 0 done, 1 done with a bad answer, 2 the caller's mistake, 3 the flown run is invalid, 128 + n
        ended by signal n.
    """
    stop_signals = _become_the_program() if arguments is None else []
    try:
        try:
            return _run(arguments)
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except KeyboardInterrupt as error:
        return _interrupted(error, stop_signals)
    except BrokenPipeError:
        _discard_output()
        return 0
    except HeliTwinError as error:
        return _fail(2, str(error), error)
    except OSError as error:
        reason = error.strerror or str(error)
        if error.filename is not None:
            return _fail(2, f"{error.filename}: {reason}", error)
        # Files are opened by name and their errors carry it: this is the standard output.
        _discard_output()
        return _fail(2, f"the output cannot be written: {reason}", error)
    except Exception as error:
        # Libraries turn an interruption of their import into errors of their own.
        if not stop_signals:
            raise
        return _interrupted(error, stop_signals)


def _run(arguments: Sequence[str] | None) -> int:
    if sys.stdout is None:
        raise HeliTwinError("the standard output is closed: redirect it to a file or to /dev/null")
    words = sys.argv[1:] if arguments is None else arguments
    parsed = commands.command_line(words[0] if words else "").parse_args(words)
    return parsed.run(parsed)


def _fail(code: int, sentence: str, error: BaseException) -> int:
    """Print one line to the standard error, with the notes that the error carries; returns the exit code."""
    notes: list[str] = getattr(error, "__notes__", [])
    if sys.stderr is not None:
        # The terminal may have been closed.
        with suppress(OSError):
            print(f"heli-twin: {clean('; '.join([sentence, *notes]))}", file=sys.stderr, flush=True)
    return code


def _interrupted(error: BaseException, stop_signals: list[int]) -> int:
    number = signal.Signals(stop_signals[0] if stop_signals else signal.SIGINT)
    sentence = "interrupted" if number == signal.SIGINT else f"ended by {number.name}"
    return _fail(128 + number, sentence, error)


def _discard_output() -> None:
    """Let the rest of the output go nowhere, and not into one more error at exit."""
    with suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _become_the_program() -> list[int]:
    """Prepare the process for a command; returns a list to which the first signal that asks it to end is added."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            # Otherwise the next file that is opened, a log, would be the standard output.
            os.open(os.devnull, os.O_RDWR)
    if isinstance(sys.stdout, TextIOWrapper):
        # A terminal that cannot show a character shows another; data are printed in ASCII.
        sys.stdout.reconfigure(errors="replace")
    # Libraries make a hundred thousand objects that stay: to look through them again and again takes a tenth of the
    # start of a command.
    gc.set_threshold(100_000, 20, 20)
    # MuJoCo would look for a window library, which takes as long as all the rest of it; nothing here draws with it.
    os.environ.setdefault("MUJOCO_GL", "disable")
    # NumPy's threads would wait for their first work at full speed, for 30 ms of every command.
    os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")
    handler = logging.StreamHandler()
    handler.setFormatter(_OneLine())
    logging.basicConfig(handlers=[handler])
    stop_signals: list[int] = []

    def stop(number: int, _: FrameType | None) -> None:
        """End the command as Ctrl-C does; later signals find it on its way out."""
        if not stop_signals:
            stop_signals.append(number)
            signal.alarm(STOP_TIMEOUT_S)
            raise Stopped(signal.Signals(number).name)

    for number in STOP_SIGNALS:
        # `nohup` ignores SIGHUP; a shell ignores SIGINT for its background jobs, which are ended by it all the same.
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, stop)
    return stop_signals


class _OneLine(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        """A warning as one line, its exception too."""
        cause = record.exc_info[1] if record.exc_info else None
        reason = f" ({type(cause).__name__}: {cause})" if cause else ""
        return f"heli-twin: {clean(record.getMessage() + reason)}"


if __name__ == "__main__":
    sys.exit(main())
