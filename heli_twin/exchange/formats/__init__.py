"""Formats of recordings, a family: each file reads one of them as exported, and recognises it by its content.

A member is a module with

- `TITLE`, its name for a person,
- `recognises(head)`, whether the first lines of a file (at most `HEAD_LINES`, without their line ends) are of it,
- `read(path, options)`, its `Take`.
"""

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, NamedTuple, Protocol

from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.recording.log import Times

HEAD_LINES = 40
"""First lines of a file that a format is recognised by."""
MAX_LINE_CHARACTERS = 200_000
MAX_ROWS = 4_000_000
"""Rows of the longest recording that is read."""


class ImportRefused(HeliTwinError):
    """A recording that cannot be imported; the message names the place and what would be right."""


class Options(NamedTuple):
    """Choices of the user that the file does not contain."""

    body: str = ""
    """Name of the body to import; empty for the only one."""
    rotation: str = ""
    """`euler` or `vector`: what three rotation columns mean; empty for the format's own assumption."""
    columns: str = ""
    """Which column is which field, for tables of unknown layout: see `table.parse_map`."""


class Take(NamedTuple):
    """A recording as its file has it, one row a frame, NaN where a cell is empty; nothing is cleaned yet."""

    title: str
    """Of the format."""
    time: Array
    """(n,) in `time_unit`."""
    position: Array
    """(n, 3) along the file's axes, m if its lengths are in `length_unit`."""
    quat_wxyz: Array
    """(n, 4) attitude of the body along the file's axes, scalar first."""
    time_unit: str = "s"
    """`s`, or `unknown`: to be found from the data."""
    length_unit: str = "m"
    """The unit that the file or its format says, which the user may know better; `mapped` if the user has said it."""
    frame: str = "zup"
    """Of the file's axes: a key of `frames.FRAMES`."""
    arrival: Array | None = None
    """(n,) when each pose reached the ground station, in `time_unit`; None where the file does not tell."""
    u: Array | None = None
    """(n, 4) commands, fraction of full stick, NaN for an input that the file does not have; None for no commands."""
    body: str = ""
    bodies: tuple[str, ...] = ()
    """All bodies of the file."""
    lines: Times | None = None
    """(n,) the line of each row in a text file, from 1 on."""
    notes: tuple[str, ...] = ()
    """Assumptions that the user should read, one sentence each."""


class Format(Protocol):
    """A member of the family."""

    TITLE: str

    def recognises(self, head: list[str]) -> bool:
        """Return whether the first lines of a file are of this format."""
        ...

    def read(self, path: Path, options: Options) -> Take:
        """Read a file of this format.

        Raises:
            ImportRefused: The file is damaged, or the body is not in it.
        """
        ...


def formats() -> dict[str, Format]:
    """The formats by the name of their module, in the order in which they are tried: any other table comes last."""
    names = sorted((module.name for module in iter_modules(__path__)), key=lambda name: (name == "table", name))
    modules: dict[str, Any] = {name: import_module(f"{__name__}.{name}") for name in names}
    return {name: module for name, module in modules.items() if hasattr(module, "recognises")}


def head_of(path: Path) -> list[str]:
    """The first lines of a text file; a binary file has lines that no text format recognises.

    Raises:
        ImportRefused: The file cannot be opened.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_LINE_CHARACTERS)
    except OSError as error:
        raise ImportRefused(f"{path} cannot be opened: {error.strerror or error}") from error
    return data.decode("utf-8-sig", errors="replace").splitlines()[:HEAD_LINES]


def chosen_body(path: Path, bodies: list[str], wanted: str) -> str:
    """The body to import.

    Raises:
        ImportRefused: There is none, there are several and none is named, or the named one is not there.
    """
    from heli_twin.terminal_text import instead

    if not bodies:
        raise ImportRefused(f"{path} has no rigid body: export rigid bodies, not markers alone")
    if not wanted and len(bodies) == 1:
        return bodies[0]
    if not wanted:
        raise ImportRefused(f"{path} has {len(bodies)} bodies: choose one with --body, of {', '.join(bodies[:20])}")
    # Vicon writes SUBJECT:SEGMENT, of which people know one half.
    matches = [name for name in bodies if wanted in (name, *name.split(":"))]
    if not matches:
        raise ImportRefused(f"{path} has no body {instead(wanted, bodies)}")
    return matches[0]
