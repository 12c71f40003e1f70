"""The end of commands and of their worker processes: on a signal, or when the process that they work for dies."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager

ORPHANED_EXIT_CODE = 1


@contextmanager
def stoppable() -> Generator[None]:
    """Make SIGTERM and SIGHUP raise KeyboardInterrupt, as Ctrl-C does, so that pools end their workers on the way out.

    Batch systems send SIGTERM, a closed terminal SIGHUP, and a shell starts background jobs with SIGINT ignored.
    Handlers that the program has set itself stay, and so does an ignored SIGHUP, which is what `nohup` asks for.
    Outside the main thread, where Python cannot set handlers, nothing changes.
    """
    before = {number: signal.getsignal(number) for number in _replaceable()}
    for number in before:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _replaceable() -> list[signal.Signals]:
    """The signals to take over: those that would end the process at once or are ignored by default."""
    if threading.current_thread() is not threading.main_thread():
        return []
    ignorable = [n for n in (signal.SIGTERM, signal.SIGINT) if signal.getsignal(n) in (signal.SIG_DFL, signal.SIG_IGN)]
    hangup = getattr(signal, "SIGHUP", None)
    return ignorable + ([hangup] if hangup and signal.getsignal(hangup) is signal.SIG_DFL else [])


def end_with_parent() -> None:
    """Make this worker process end as soon as the process that it works for is gone, in whatever way that ended.

    A thread waits on a pipe whose other end only that process holds. A hang-up is left to that process, which may be
    meant to survive it.
    """
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    threading.Thread(target=_exit_after_parent, name="end-with-parent", daemon=True).start()


def _exit_after_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(ORPHANED_EXIT_CODE)
