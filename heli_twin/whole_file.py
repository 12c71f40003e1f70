"""Files that are either not there or whole, under names that nobody has taken."""

from collections.abc import Generator
from contextlib import contextmanager
from os.path import lexists
from pathlib import Path


def part_of(path: Path) -> Path:
    """Where a file grows until it is whole: `NAME.part`."""
    return path.with_name(path.name + ".part")


@contextmanager
def whole_file(path: Path) -> Generator[Path]:
    """Write a file under another name first; it gets its own when the block ends, and is removed if the block raises.

    Yields:
        The path to write to.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = part_of(path)
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
