"""Loads the classes that a user names, and sends them to other processes.

A name is a file, `./my_law.py`, with the class where it holds several, `./my_law.py:Mine`; or an import path,
`my_package.laws:Mine`.
"""

import hashlib
import inspect
import re
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from heli_twin.experiment.families import (
    DESIGNS,
    HELI_TWIN,
    FamilyError,
    Member,
    is_member,
    kind_of,
    name_member,
    named_members,
    specs_in,
)
from heli_twin.experiment.family_needs import family_of, nearest_family

_FILE = re.compile(r"(?P<file>.+\.py)(:(?P<name>[A-Za-z_]\w*))?")
_IMPORT = re.compile(r"(?P<module>[A-Za-z_][\w.]*):(?P<name>[A-Za-z_]\w*)")
_sources: dict[str, bytes] = {}
"""Of each module that was made from a user's file: its source."""


def is_reference(text: str) -> bool:
    """Return whether a text names a member by a file or an import path, not by its kind."""
    return bool(_FILE.fullmatch(text) or _IMPORT.fullmatch(text))


def own_member(package: str, reference: str) -> str:
    """Load a member that is named by a file or an import path, for the rest of this process.

    Args:
        package: The family.
        reference: `./my_law.py`, `./my_law.py:Mine` or `my_package.laws:Mine`.

    Returns:
        Its kind.

    Raises:
        FamilyError: There is no such class, or its kind belongs to another member.
    """
    module, name = _module_at(reference)
    spec = _chosen(package, reference, module, name)
    name_member(package, Member(spec, reference))
    return kind_of(spec)


def own_member_in(folder: Path, package: str, reference: str) -> str:
    """Load a member like `own_member`; a file is named from a folder on."""
    return own_member(package, str(folder / reference) if _FILE.fullmatch(reference) else reference)


def own_members(reference: str) -> None:
    """Load every member that a file or an import path holds, for the rest of this process.

    Raises:
        FamilyError: It cannot be loaded, holds no member, or a kind belongs to another member.
    """
    specs = [(package, spec) for package, spec in specs_at(reference) if package]
    if not specs:
        raise FamilyError(f"{reference} holds no member of a family: a frozen dataclass with a field kind")
    for package, spec in specs:
        own_member(package, reference if reference.endswith(f":{spec.__name__}") else f"{reference}:{spec.__name__}")


def specs_at(reference: str) -> list[tuple[str, type]]:
    """The members that a file or an import path holds, each with the package of its family; of none, it is empty.

    Raises:
        FamilyError: It cannot be loaded, or there is no such class.
    """
    module, name = _module_at(reference)
    specs = specs_in(module) if name is None else [_named_class(reference, module, name)]
    return [(nearest_family(spec), spec) for spec in specs]


def _chosen(package: str, reference: str, module: ModuleType, name: str | None) -> type:
    if name:
        return _named_class(reference, module, name)
    candidates = [spec for spec in specs_in(module) if family_of(spec) == package]
    if len(candidates) != 1:
        names = ", ".join(spec.__name__ for spec in candidates or specs_in(module)) or "no dataclass with a kind"
        raise FamilyError(
            f"{reference} has {len(candidates)} members of {package.rpartition('.')[2]}: it holds {names}; name one,"
            f" as in {reference}:CLASS"
        )
    return candidates[0]


def _named_class(reference: str, module: ModuleType, name: str) -> type:
    spec = getattr(module, name, None)
    if not is_member(spec):
        raise FamilyError(f"{reference}: {name} is no dataclass with a field kind")
    return spec


def origin_of(spec: type) -> str:
    """The file name, import path or package that a class comes from; never a path of this machine."""
    for _, member in named_members():
        if member.spec is spec:
            return _sent_reference(member)
    module = spec.__module__
    return HELI_TWIN if module.partition(".")[0] in (HELI_TWIN, "controllers") else f"{module}:{spec.__qualname__}"


class OwnSource(NamedTuple):
    """A member of a user's own, as it is sent to another process."""

    package: str
    """Of its family."""
    reference: str
    """The import path, or the name of its file."""
    class_name: str
    source: bytes
    """Of its file; empty where it is imported."""


def own_sources() -> tuple[OwnSource, ...]:
    """The members that were named in this process, for another process; see `load_own_sources`."""
    return tuple(
        OwnSource(package, _sent_reference(member), member.spec.__name__, _sources.get(member.spec.__module__, b""))
        for package, member in named_members()
        # Designs choose what to fly: they are needed by no worker.
        if package != DESIGNS
    )


def _sent_reference(member: Member) -> str:
    match = _FILE.fullmatch(member.origin)
    return Path(match["file"]).name if match else member.origin


def load_own_sources(sources: Sequence[OwnSource]) -> None:
    """Make the members of another process those of this one.

    Raises:
        FamilyError: One cannot be loaded here.
    """
    for package, reference, class_name, source in sources:
        if not source:
            own_member(package, reference)
            continue
        spec = _named_class(reference, _module_from(Path(reference), source), class_name)
        name_member(package, Member(spec, reference))


def source_of(spec: type) -> bytes:
    """The source of the module that defines a class; empty where there is none, as in a prompt."""
    if spec.__module__ in _sources:
        return _sources[spec.__module__]
    try:
        return inspect.getsource(sys.modules[spec.__module__]).encode()
    except (OSError, TypeError, KeyError):
        return b""


def source_hash(spec: type) -> str:
    """A hash of the source of the module that defines a class; `unknown` where there is none."""
    source = source_of(spec)
    return hashlib.sha256(b"\n".join(source.splitlines())).hexdigest()[:16] if source else "unknown"


def _module_at(reference: str) -> tuple[ModuleType, str | None]:
    if match := _FILE.fullmatch(reference):
        return _module_of(Path(match["file"])), match["name"]
    if match := _IMPORT.fullmatch(reference):
        try:
            return import_module(match["module"]), match["name"]
        except Exception as error:
            raise FamilyError(f"{reference} cannot be imported: {type(error).__name__}: {error}") from error
    raise FamilyError(f"'{reference}' names no class: write ./FILE.py, ./FILE.py:CLASS or PACKAGE.MODULE:CLASS")


def _module_of(file: Path) -> ModuleType:
    """A user's file as a module; its folder is on the path while it loads, as for a script."""
    try:
        source = file.read_bytes()
    except OSError as error:
        raise FamilyError(f"{file} cannot be opened: {error.strerror or error}") from None
    folder = str(file.parent.absolute())
    sys.path.insert(0, folder)
    try:
        return _module_from(file, source)
    finally:
        sys.path.remove(folder)


def _module_from(file: Path, source: bytes) -> ModuleType:
    name = f"heli_twin_own_{file.stem}_{hashlib.sha256(source).hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    module = ModuleType(name)
    module.__file__ = str(file)
    # Dataclasses look for their module.
    sys.modules[name] = module
    _sources[name] = source
    try:
        exec(compile(source, str(file), "exec"), module.__dict__)
    except BaseException as error:
        del sys.modules[name], _sources[name]
        if not isinstance(error, Exception):
            raise
        line = error.lineno if isinstance(error, SyntaxError) else _line_in(str(file), error)
        raise FamilyError(f"{file}, line {line} cannot be loaded: {type(error).__name__}: {error}") from error
    return module


def _line_in(file: str, error: Exception) -> int:
    """The last line of a file that an exception went through."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
    return (lines or [0])[-1] or 0
