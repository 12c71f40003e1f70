"""Families of interchangeable parts, ours and those of strangers.

A member of ours is found by looking at the files, without a registry. A stranger's is one of

- a class in a file of the user's, named by its path: `./my_law.py`, or `./my_law.py:Mine` where it holds several;
- a class that can be imported, named as `my_package.laws:Mine`;
- an entry point of an installed package, in the group of its family (`GROUPS`), named by its kind.

A member is a frozen dataclass with a field `kind`.
"""

import hashlib
import importlib.util
import re
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType, TracebackType
from typing import Any, NamedTuple, TypeGuard

from controllers.markers import EachOf, OneOf
from heli_twin.errors import HeliTwinError

__all__ = ["GROUPS", "EachOf", "FamilyError", "Member", "OneOf", "all_members", "members", "own_member"]

GROUPS = {
    "controllers.trajectories": "heli_twin.trajectories",
    "controllers.laws": "heli_twin.controllers",
    "controllers.estimators": "heli_twin.estimators",
    "heli_twin.lab.plant": "heli_twin.plants",
    "heli_twin.lab.disturbances": "heli_twin.disturbances",
    "heli_twin.lab.faults": "heli_twin.faults",
    "heli_twin.studies.designs": "heli_twin.designs",
}
"""The group of entry points of each family that is open to other packages."""
_FILE = re.compile(r"(?P<file>.+\.py)(:(?P<name>[A-Za-z_]\w*))?")
_IMPORT = re.compile(r"(?P<module>[A-Za-z_][\w.]*):(?P<name>[A-Za-z_]\w*)")


class FamilyError(HeliTwinError):
    """A member that cannot be loaded, or two that have one kind."""


class Member(NamedTuple):
    """A member of a family."""

    spec: type
    origin: str
    """For a person: `heli_twin`, the file, the import path or the package that it comes from."""


_named: dict[str, dict[str, Member]] = {}
"""Of each family: the members that were named by a file or an import path, in this process."""


def members(package: str) -> dict[str, type]:
    """The specs of a family by their `kind`, in alphabetical order."""
    return {kind: member.spec for kind, member in all_members(package).items()}


def all_members(package: str) -> dict[str, Member]:
    """The members of a family by their `kind`, in alphabetical order.

    Raises:
        FamilyError: Two members have one kind, or an installed package is broken.
    """
    family = dict(_ours(package))
    for other in (_installed(package), _named.get(package, {})):
        for kind, member in other.items():
            _add(family, kind, member)
    return dict(sorted(family.items()))


def _add(family: dict[str, Member], kind: str, member: Member) -> None:
    if kind in family and family[kind].spec is not member.spec:
        raise FamilyError(
            f"two members have the kind '{kind}': that of {family[kind].origin} and that of {member.origin}; rename one"
        )
    family[kind] = member


@cache
def _ours(package: str) -> dict[str, Member]:
    home = import_module(package)
    rooms = iter_modules(getattr(home, "__path__", []))
    modules: list[ModuleType] = [home, *(import_module(f"{package}.{room.name}") for room in rooms)]
    return {_kind(spec): Member(spec, "heli_twin") for module in modules for spec in _specs_in(module)}


@cache
def _installed(package: str) -> dict[str, Member]:
    family: dict[str, Member] = {}
    for point in sorted(entry_points(group=GROUPS.get(package, "")), key=lambda point: point.name):
        origin = f"the package {point.dist.name if point.dist else point.value}"
        try:
            spec = point.load()
        except Exception as error:
            raise FamilyError(f"{origin} is broken: {point.value} raised {type(error).__name__}: {error}") from error
        if not _is_member(spec):
            raise FamilyError(f"{origin} is broken: {point.value} is no dataclass with a kind")
        _add(family, _kind(spec), Member(spec, origin))
    return family


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
    kind = _kind(spec)
    # A file that has changed since it was named holds another class.
    named = _named.setdefault(package, {})
    named.pop(kind, None)
    _add(all_members(package), kind, Member(spec, reference))
    named[kind] = Member(spec, reference)
    return kind


def specs_at(reference: str) -> list[tuple[str, type]]:
    """The members that a file or an import path holds, each with the package of its family.

    Raises:
        FamilyError: It cannot be loaded, or there is no such class.
    """
    module, name = _module_at(reference)
    specs = _specs_in(module) if name is None else [_named_class(reference, module, name)]
    return [(_family_of(spec), spec) for spec in specs]


def _module_at(reference: str) -> tuple[ModuleType, str | None]:
    if match := _FILE.fullmatch(reference):
        return _module_of(Path(match["file"])), match["name"]
    if match := _IMPORT.fullmatch(reference):
        try:
            return import_module(match["module"]), match["name"]
        except Exception as error:
            raise FamilyError(f"{reference} cannot be imported: {type(error).__name__}: {error}") from error
    raise FamilyError(f"'{reference}' names no class: write ./FILE.py, ./FILE.py:CLASS or PACKAGE.MODULE:CLASS")


def _family_of(spec: type) -> str:
    """The family whose attributes a class has; one that only starts with a generator is a disturbance."""
    fit = [package for package in _NEEDS if _fits(package, spec)]
    if fit:
        return max(fit, key=lambda package: len(_NEEDS[package]))
    return "heli_twin.lab.disturbances" if hasattr(spec, "start") else "heli_twin.lab.faults"


def _chosen(package: str, reference: str, module: ModuleType, name: str | None) -> type:
    if name:
        return _named_class(reference, module, name)
    candidates = [spec for spec in _specs_in(module) if _fits(package, spec)]
    if len(candidates) != 1:
        names = ", ".join(spec.__name__ for spec in candidates or _specs_in(module)) or "no dataclass with a kind"
        raise FamilyError(
            f"{reference} has {len(candidates)} members of {package.rpartition('.')[2]}: it holds {names}; name one,"
            f" as in {reference}:CLASS"
        )
    return candidates[0]


def _named_class(reference: str, module: ModuleType, name: str) -> type:
    spec = getattr(module, name, None)
    if not _is_member(spec):
        raise FamilyError(f"{reference}: {name} is no dataclass with a field kind")
    return spec


_NEEDS = {
    "controllers.trajectories": ("flat",),
    "controllers.laws": ("period", "steps", "model", "start"),
    "controllers.estimators": ("lead", "start"),
    "heli_twin.lab.plant": ("step", "start"),
}
_MARKS = {name for needs in _NEEDS.values() for name in needs} - {"start"}


def _fits(package: str, spec: type) -> bool:
    """Whether a class has what its family needs, and no mark of another."""
    names = {f.name for f in fields(spec)} | set(dir(spec))
    needs = _NEEDS.get(package)
    return all(name in names for name in needs) if needs else not names & _MARKS


def _module_of(file: Path) -> ModuleType:
    """A user's file as a module; its folder is on the path while it loads, as for a script."""
    try:
        source = file.read_bytes()
    except OSError as error:
        raise FamilyError(f"{file} cannot be opened: {error.strerror or error}") from None
    name = f"heli_twin_own_{file.stem}_{hashlib.sha256(source).hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise FamilyError(f"{file} is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.insert(0, str(file.parent.absolute()))
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        line = next((f", line {t.tb_lineno}" for t in _frames(error) if t.tb_frame.f_code.co_filename == str(file)), "")
        raise FamilyError(f"{file}{line} cannot be loaded: {type(error).__name__}: {error}") from error
    finally:
        sys.path.remove(str(file.parent.absolute()))
    return module


def _frames(error: BaseException) -> Iterator[TracebackType]:
    trace = error.__traceback__
    while trace is not None:
        yield trace
        trace = trace.tb_next


def _specs_in(module: ModuleType) -> list[type]:
    """The members that are defined in a module, in the order of their text."""
    return [value for value in vars(module).values() if _is_member(value) and value.__module__ == module.__name__]


def _is_member(value: Any) -> TypeGuard[type]:
    return isinstance(value, type) and is_dataclass(value) and any(f.name == "kind" for f in fields(value))


def _kind(spec: type) -> str:
    return str(next(f.default for f in fields(spec) if f.name == "kind"))  # pyright: ignore[reportArgumentType]
