"""Files that are either not there or whole, under names that nobody has taken."""

import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from os.path import lexists
from pathlib import Path
from threading import current_thread, main_thread
from types import FrameType
from typing import Any

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that ask a program to end."""


def part_of(path: Path) -> Path:
    """Return the path under which a file is written until it is complete: `NAME.part`."""
    return path.with_name(path.name + ".part")


@contextmanager
def uninterrupted() -> Generator[None]:
    """Let a block that writes a file end before SIGINT, SIGTERM or SIGHUP takes effect.

    Without handlers of these signals, and outside the main thread, nothing changes.
    """
    held: list[tuple[int, FrameType | None]] = []
    handlers: dict[int, Callable[[int, FrameType | None], Any]] = {}
    try:
        for number in STOP_SIGNALS if current_thread() is main_thread() else ():
            handler = signal.getsignal(number)
            if callable(handler):
                handlers[number] = handler
                signal.signal(number, lambda number, frame: held.append((number, frame)))
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number, frame in held[:1]:
            handlers[number](number, frame)


@contextmanager
def whole_file(path: Path, part: Path | None = None) -> Generator[Path]:
    """Write a file under another name first; it gets its own when the block ends, and is removed if the block raises.

    Args:
        path: Name of the finished file.
        part: Name of the unfinished one; by default `part_of(path)`.

    Yields:
        The path to write to.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = part or part_of(path)
    try:
        yield part
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_whole(path: Path, data: bytes) -> None:
    """Write a file that is either not there or whole; its folder is made if need be."""
    with whole_file(path) as part:
        part.write_bytes(data)


def free_path(path: Path) -> Path:
    """`path`, or if it or its `.part` is taken, the first free of `NAME-2.EXT`, `NAME-3.EXT`, ...

    It only looks: another process may take the name before it is used.
    """
    free, count = path, 1
    while lexists(free) or lexists(part_of(free)):
        count += 1
        free = path.with_name(f"{path.stem}-{count}{path.suffix}")
    return free
