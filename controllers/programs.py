"""Programs of the user's own that are control laws: what an experiment says of them, and where they are here.

A command is a program and its arguments, such as `("./pid", "--gain=2")` or `("python3", "law.py")`. An experiment
says its marks: of a word that names a file the name of the file and a hash of its content, `pid@3f2a51bc90aa11ee`; of a
program on the search path `python3@PATH`; and any other word as it is. So no path of a machine is in an experiment.

A marked command is run only if its user has named it in this process: what a log or a store says is never run.
"""

import hashlib
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from re import compile as pattern
from shutil import which
from tempfile import TemporaryDirectory
from typing import NamedTuple

Marks = tuple[str, ...]

MAX_SENT_BYTES = 1_000_000
"""A larger file is not sent to workers on other machines: it has to be there, under the same path."""
_MARKED = pattern(r"[^@/\\]+@(PATH|[0-9a-f]{16})")


class ProgramFile(NamedTuple):
    """A file that a command names."""

    place: int
    """Its word in the command."""
    is_executable: bool
    content: bytes | None
    """None if it is not sent to other machines."""


class Program(NamedTuple):
    """A command that its user has named."""

    marks: Marks
    words: tuple[str, ...]
    """The command, with the paths of its files on the machine where it was named."""
    files: tuple[ProgramFile, ...]
    was_sent: bool = False
    """True in a worker, which may be on another machine."""


_named: dict[Marks, Program] = {}
"""The commands that were named in this process."""
_supplied: list[Marks] = []
"""Those of them that stand in for commands that are known by their marks alone."""


def is_marked(words: Sequence[str]) -> bool:
    """Return whether a command is written as marks; an empty one is too."""
    return not words or _MARKED.fullmatch(words[0]) is not None


def named(words: Sequence[str]) -> Marks:
    """Name a command, for the rest of this process.

    Args:
        words: The program and its arguments, or marks. A program without a folder is looked for on the search path.

    Returns:
        Its marks.

    Raises:
        ValueError: There is no such program, it cannot be run, or a word holds a path that names no file.
    """
    if is_marked(words):
        return tuple(words)
    marks, paths, files = list(words), list(words), list[ProgramFile]()
    for place, word in enumerate(words):
        if place == 0 and "/" not in word:
            marks[0] = _on_the_search_path(word)
        elif "\0" not in word and Path(word).is_file():
            path = Path(word).absolute()
            marks[place], paths[place] = f"{path.name}@{_hash(path)}", str(path)
            files.append(_file(place, path))
        elif not word.isprintable() or "/" in word or "\\" in word:
            what = (
                "a path has to name a file, whose content is logged in its place" if place else "there is no such file"
            )
            raise ValueError(f"command[{place}] = {word[:200]!r}: {what}")
    if files and files[0].place == 0 and not files[0].is_executable:
        raise ValueError(
            f"command[0] = {words[0][:200]!r} is not executable: chmod +x it, or put its interpreter before"
        )
    if not is_marked(marks):
        raise ValueError(f"command[0] = {words[0][:200]!r}: a program's name cannot contain @")
    _named[tuple(marks)] = Program(tuple(marks), tuple(paths), tuple(files))
    return tuple(marks)


def _on_the_search_path(word: str) -> str:
    if "\0" not in word and which(word):
        return f"{word}@PATH"
    advice = f"write ./{word}" if "\0" not in word and Path(word).is_file() else "name a file with its folder, as ./pid"
    raise ValueError(f"command[0] = {word[:200]!r}: there is no such program on the search path; {advice}")


def _file(place: int, path: Path) -> ProgramFile:
    at = path.stat()
    content = path.read_bytes() if at.st_size <= MAX_SENT_BYTES else None
    return ProgramFile(place, bool(at.st_mode & 0o111), content)


def _hash(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:16]
    except OSError as error:
        raise ValueError(f"command: {path.name} cannot be read: {error.strerror or error}") from None


def supply(words: Sequence[str]) -> Marks:
    """Name a command that stands in for those that a log or a store knows by their marks alone.

    Raises:
        ValueError: As for `named`.
    """
    _supplied.append(named(words))
    return _supplied[-1]


def at_hand(marks: Marks) -> Marks:
    """The command that is run in place of one that a log names: the same, or that which was supplied last."""
    return marks if not marks or marks in _supplied or not _supplied else _supplied[-1]


def program_at(marks: Marks) -> Program:
    """The command with these marks.

    Raises:
        ValueError: Its user has not named it here, or its files are not here as they were.
    """
    if not marks:
        raise ValueError('command is empty: name the program that is the law, as in controller.command=["./pid"]')
    if marks not in _named:
        raise ValueError(
            f"command = {' '.join(marks)[:120]!r} says what a program is and not where, since no program is run because"
            ' a log or a store says so: name it, as in controller.command=["./pid"], or --with ./pid where a log or a'
            " store is read"
        )
    program = _named[marks]
    for file in program.files:
        if not _is_here(program, file) and not (program.was_sent and file.content is not None):
            raise ValueError(
                f"command[{file.place}] = {marks[file.place]!r} is not here any more, or has changed since it was named"
                if not program.was_sent
                else f"command[{file.place}] = {marks[file.place]!r} is larger than {MAX_SENT_BYTES} bytes, so it was"
                " not sent to this machine: put the same file under the same path here"
            )
    return program


def _is_here(program: Program, file: ProgramFile) -> bool:
    path = Path(program.words[file.place])
    return path.is_file() and program.marks[file.place].endswith(f"@{_hash(path)}")


def unpacked(program: Program, until: ExitStack) -> list[str]:
    """The words to run; files that another machine sent are in temporary folders until the stack is closed."""
    words = list(program.words)
    for file in program.files:
        if file.content is not None and not _is_here(program, file):
            folder = until.enter_context(TemporaryDirectory(prefix="heli_twin_law_"))
            path = Path(folder) / program.marks[file.place].rpartition("@")[0]
            path.write_bytes(file.content)
            path.chmod(0o700 if file.is_executable else 0o600)
            words[file.place] = str(path)
    return words


def to_send() -> tuple[Program, ...]:
    """The commands that were named in this process, for another process; see `receive`."""
    return tuple(_named.values())


def receive(programs: Iterable[Program]) -> None:
    """Make the commands of another process those of this one."""
    for program in programs:
        _named[program.marks] = program._replace(was_sent=True)


def beside(folder: Path, words: Sequence[str]) -> list[str]:
    """The words of a command that stands in a file: what names a file names it from the folder of that file on."""
    return [
        # Not `str(folder / word)`: of `./pid` it leaves `pid`, which is looked for on the search path.
        f"{folder}/{word}" if (place or "/" in word) and _is_file_in(folder, word) else word
        for place, word in enumerate(words)
    ]


def _is_file_in(folder: Path, word: str) -> bool:
    return not word.startswith("/") and "\0" not in word and (folder / word).is_file()
