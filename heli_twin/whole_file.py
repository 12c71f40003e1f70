"""Files that are either not there or whole."""

from pathlib import Path


def write_whole(path: Path, data: bytes) -> None:
    """Write a file that is either not there or whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    part.write_bytes(data)
    part.replace(path)
