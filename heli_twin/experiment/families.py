"""Families of interchangeable parts, ours and those of strangers.

A member of ours is found by looking at the files, without a registry. A stranger's is one of

- a class in a file of the user's, named by its path: `./my_law.py`, or `./my_law.py:Mine` where it holds several;
- a class that can be imported, named as `my_package.laws:Mine`;
- an entry point of an installed package, in the group of its family (`GROUPS`), named by its kind.

A member is a frozen dataclass with a field `kind`.
"""

import hashlib
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache, partial
from importlib import import_module
from importlib.metadata import entry_points
from itertools import chain
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import Any, NamedTuple, TypeGuard, TypeVar

from controllers.markers import EachOf, OneOf
from heli_twin.errors import HeliTwinError
from heli_twin.experiment.help_text import explained

__all__ = ["GROUPS", "EachOf", "Family", "FamilyError", "Member", "OneOf", "all_members", "members", "own_member"]

HELI_TWIN = "heli_twin"
"""The origin of our own members."""
DESIGNS = "heli_twin.studies.designs"
"""The family of the designs of studies, which choose what to fly."""
GROUPS = {
    "controllers.trajectories": "heli_twin.trajectories",
    "controllers.laws": "heli_twin.controllers",
    "controllers.estimators": "heli_twin.estimators",
    "controllers.excitations": "heli_twin.excitations",
    "controllers.supervisors": "heli_twin.supervisors",
    "controllers.coordinations": "heli_twin.coordinations",
    "heli_twin.lab.plant": "heli_twin.plants",
    "heli_twin.lab.disturbances": "heli_twin.disturbances",
    "heli_twin.lab.faults": "heli_twin.faults",
    DESIGNS: "heli_twin.designs",
}
"""The group of entry points of each family that is open to other packages."""
_KIND = re.compile(r'^    kind: Literal\["(\w+)"\] = "\1"$', re.MULTILINE)
"""The first field of a member of ours."""
_FILE = re.compile(r"(?P<file>.+\.py)(:(?P<name>[A-Za-z_]\w*))?")
_IMPORT = re.compile(r"(?P<module>[A-Za-z_][\w.]*):(?P<name>[A-Za-z_]\w*)")


class FamilyError(HeliTwinError):
    """A member that cannot be loaded, or two that have one kind."""


class Member(NamedTuple):
    """A member of a family."""

    spec: type
    origin: str
    """For a person: `heli_twin`, the file, the import path or the package that it comes from."""


class OwnSource(NamedTuple):
    """A member of a user's own, as it is sent to another process."""

    package: str
    """Of its family."""
    reference: str
    """The import path, or the name of its file."""
    class_name: str
    source: bytes
    """Of its file; empty where it is imported."""


_named: dict[str, dict[str, Member]] = {}
"""Of each family: the members that were named by a file or an import path, in this process."""


T = TypeVar("T")


class Family(Mapping[str, T]):
    """Members by their kind, in alphabetical order; one is loaded when it is asked for.

    Args:
        loaders: Return the member of each kind.
    """

    def __init__(self, loaders: Mapping[str, Callable[[], T]]) -> None:
        self._loaders = dict(sorted(loaders.items()))

    def __getitem__(self, kind: str) -> T:
        return self._loaders[kind]()

    def __contains__(self, kind: object) -> bool:
        return kind in self._loaders

    def __iter__(self) -> Iterator[str]:
        return iter(self._loaders)

    def __len__(self) -> int:
        return len(self._loaders)


def members(package: str) -> Family[type]:
    """The specs of a family by their `kind`, in alphabetical order."""
    return _both(package)[1]


def all_members(package: str) -> Family[Member]:
    """The members of a family by their `kind`, in alphabetical order.

    Raises:
        FamilyError: Two members have one kind, or an installed package is broken.
    """
    return _both(package)[0]


def _both(package: str) -> tuple[Family[Member], Family[type]]:
    named = _named.get(package)
    return _put_together(_ours(package), _installed(package), named) if named else _not_named(package)


@cache
def _not_named(package: str) -> tuple[Family[Member], Family[type]]:
    return _put_together(_ours(package), _installed(package))


def _put_together(
    ours: Mapping[str, Callable[[], Member]], *others: Mapping[str, Member]
) -> tuple[Family[Member], Family[type]]:
    loaders = dict(ours)
    for kind, member in chain.from_iterable(other.items() for other in others):
        if kind in loaders:
            _require_same(kind, loaders[kind](), member)
        loaders[kind] = partial(_itself, member)
    return Family(loaders), Family({kind: partial(_spec, loader) for kind, loader in loaders.items()})


def _spec(loader: Callable[[], Member]) -> type:
    return loader().spec


def _itself(member: Member) -> Member:
    return member


def _require_same(kind: str, one: Member, other: Member) -> None:
    if one.spec is not other.spec:
        raise FamilyError(
            f"two members have the kind '{kind}': that of {one.origin} and that of {other.origin}; rename one"
        )


@cache
def _ours(package: str) -> dict[str, Callable[[], Member]]:
    """Our own members; the text of a file tells their kinds, so that a flight loads those alone that it needs."""
    home = import_module(package)
    loaders = {_kind(spec): partial(_loaded, package, _kind(spec)) for spec in _specs_in(home)}
    for room in iter_modules(getattr(home, "__path__", [])):
        module = f"{package}.{room.name}"
        file = Path(getattr(room.module_finder, "path", "")) / f"{room.name}.py"
        if file.is_file():
            kinds = _KIND.findall(file.read_text("utf-8"))
        else:
            # A package, or a module without its source.
            kinds = [_kind(spec) for spec in _specs_in(import_module(module))]
        loaders |= {kind: partial(_loaded, module, kind) for kind in kinds}
    return loaders


@cache
def _loaded(module: str, kind: str) -> Member:
    spec = next(spec for spec in _specs_in(import_module(module)) if _kind(spec) == kind)
    return Member(explained(spec), HELI_TWIN)


@cache
def _entry_points() -> Any:
    """Cached: every look reads the metadata of all installed packages."""
    return entry_points()


@cache
def _installed(package: str) -> dict[str, Member]:
    family: dict[str, Member] = {}
    for point in sorted(_entry_points().select(group=GROUPS.get(package, "")), key=lambda point: point.name):
        origin = f"the package {point.dist.name if point.dist else point.value}"
        try:
            spec = point.load()
        except Exception as error:
            raise FamilyError(f"{origin} is broken: {point.value} raised {type(error).__name__}: {error}") from error
        if not _is_member(spec):
            raise FamilyError(f"{origin} is broken: {point.value} is no dataclass with a kind")
        kind, member = _kind(spec), Member(spec, origin)
        _require_same(kind, family.setdefault(kind, member), member)
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
    member = Member(spec, reference)
    _require_same(kind, all_members(package).get(kind, member), member)
    named[kind] = member
    return kind


def own_member_in(folder: Path, package: str, reference: str) -> str:
    """Load a member like `own_member`; a file is named from a folder on."""
    return own_member(package, str(folder / reference) if _FILE.fullmatch(reference) else reference)


def origin_of(spec: type) -> str:
    """The file name, import path or package that a class comes from; never a path of this machine."""
    for family in _named.values():
        for member in family.values():
            if member.spec is spec:
                return _sent_reference(member)
    module = spec.__module__
    return HELI_TWIN if module.partition(".")[0] in (HELI_TWIN, "controllers") else f"{module}:{spec.__qualname__}"


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


def own_sources() -> tuple[OwnSource, ...]:
    """The members that were named in this process, for another process; see `load_own_sources`."""
    return tuple(
        OwnSource(package, _sent_reference(member), member.spec.__name__, _sources.get(member.spec.__module__, b""))
        for package, family in _named.items()
        # Designs choose what to fly: they are needed by no worker.
        if package != DESIGNS
        for member in family.values()
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
        _named.setdefault(package, {})[_kind(spec)] = Member(spec, reference)


def specs_at(reference: str) -> list[tuple[str, type]]:
    """The members that a file or an import path holds, each with the package of its family; of none, it is empty.

    Raises:
        FamilyError: It cannot be loaded, or there is no such class.
    """
    module, name = _module_at(reference)
    specs = _specs_in(module) if name is None else [_named_class(reference, module, name)]
    return [(_nearest_family(spec), spec) for spec in specs]


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
    """The family of a class: the one with the most attributes of which it has all; empty if there is none."""
    names = {f.name for f in fields(spec)} | set(dir(spec))
    fit = [package for package, needs in _NEEDS.items() if names.issuperset(needs)]
    family = max(fit, key=lambda package: len(_NEEDS[package]), default="")
    # Both only start: a disturbance with a generator, a supervisor with a model and a period.
    start: Any = getattr(spec, "start", None)
    if family == "heli_twin.lab.disturbances" and callable(start) and len(inspect.signature(start).parameters) == 3:
        return "controllers.supervisors"
    return family


def needs_of_families() -> str:
    """The members of each family's classes, for a person: `trajectories flat; laws period, steps, model, start`."""
    return "; ".join(f"{package.rpartition('.')[2]} {', '.join(needs)}" for package, needs in _NEEDS.items())


def _nearest_family(spec: type) -> str:
    """The family of a class or, if attributes are missing, that of which it has the most; empty if it has none."""
    names = {f.name for f in fields(spec)} | set(dir(spec))
    found = {package: len(names.intersection(needs)) - 0.5 * len(needs) for package, needs in _NEEDS.items()}
    best = max(found, key=lambda package: found[package])
    exact = _family_of(spec)
    return best if found[best] > max(found.get(exact, 0.5), 0.5) or (not exact and found[best] >= 0.0) else exact


def _chosen(package: str, reference: str, module: ModuleType, name: str | None) -> type:
    if name:
        return _named_class(reference, module, name)
    candidates = [spec for spec in _specs_in(module) if _family_of(spec) == package]
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
    "controllers.excitations": ("excited",),
    "controllers.coordinations": ("planner_of",),
    "heli_twin.lab.plant": ("step", "start"),
    "heli_twin.lab.faults": ("hooks",),
    "heli_twin.lab.disturbances": ("start",),
    DESIGNS: ("adaptive", "check", "count", "batches"),
}
"""The attributes that tell the family of a class."""

_sources: dict[str, bytes] = {}
"""Of each module that was made from a user's file: its source."""


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


def _specs_in(module: ModuleType) -> list[type]:
    """The members that are defined in a module, in the order of their text."""
    return [value for value in vars(module).values() if _is_member(value) and value.__module__ == module.__name__]


def _is_member(value: Any) -> TypeGuard[type]:
    return isinstance(value, type) and is_dataclass(value) and any(f.name == "kind" for f in fields(value))


def _kind(spec: type) -> str:
    return str(next(f.default for f in fields(spec) if f.name == "kind"))  # pyright: ignore[reportArgumentType]
