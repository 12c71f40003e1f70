"""Families of interchangeable parts, ours and those of strangers.

A member of ours is found by looking at the files, without a registry. A stranger's is one of

- a class that the user names by its file or its import path (`named_classes.py`);
- an entry point of an installed package, in the group of its family (`GROUPS`), named by its kind.

A member is a frozen dataclass with a field `kind`.
"""

import re
from collections.abc import Callable, Iterator, Mapping
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

__all__ = ["GROUPS", "EachOf", "Family", "FamilyError", "Member", "OneOf", "all_members", "members"]

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


class FamilyError(HeliTwinError):
    """A member that cannot be loaded, or two that have one kind."""


class Member(NamedTuple):
    """A member of a family."""

    spec: type
    origin: str
    """For a person: `heli_twin`, the file, the import path or the package that it comes from."""


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


def name_member(package: str, member: Member) -> None:
    """Make a class that a user named a member of a family, for the rest of this process.

    It takes the place of one that was named before with its kind: a file that has changed holds another class.

    Raises:
        FamilyError: Its kind belongs to another member.
    """
    kind = kind_of(member.spec)
    named = _named.setdefault(package, {})
    named.pop(kind, None)
    _require_same(kind, all_members(package).get(kind, member), member)
    named[kind] = member


def named_members() -> Iterator[tuple[str, Member]]:
    """Yield the package of its family and the member of everything that was named in this process."""
    return ((package, member) for package, family in _named.items() for member in family.values())


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
    loaders = {kind_of(spec): partial(_loaded, package, kind_of(spec)) for spec in specs_in(home)}
    for room in iter_modules(getattr(home, "__path__", [])):
        module = f"{package}.{room.name}"
        file = Path(getattr(room.module_finder, "path", "")) / f"{room.name}.py"
        if file.is_file():
            kinds = _KIND.findall(file.read_text("utf-8"))
        else:
            # A package, or a module without its source.
            kinds = [kind_of(spec) for spec in specs_in(import_module(module))]
        loaders |= {kind: partial(_loaded, module, kind) for kind in kinds}
    return loaders


@cache
def _loaded(module: str, kind: str) -> Member:
    spec = next(spec for spec in specs_in(import_module(module)) if kind_of(spec) == kind)
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
        if not is_member(spec):
            raise FamilyError(f"{origin} is broken: {point.value} is no dataclass with a kind")
        kind, member = kind_of(spec), Member(spec, origin)
        _require_same(kind, family.setdefault(kind, member), member)
    return family


def specs_in(module: ModuleType) -> list[type]:
    """The members that are defined in a module, in the order of their text."""
    return [value for value in vars(module).values() if is_member(value) and value.__module__ == module.__name__]


def is_member(value: Any) -> TypeGuard[type]:
    """Return whether a value is a dataclass with a field `kind`."""
    return isinstance(value, type) and is_dataclass(value) and any(f.name == "kind" for f in fields(value))


def kind_of(spec: type) -> str:
    """Return the kind of a member's class."""
    return str(next(f.default for f in fields(spec) if f.name == "kind"))  # pyright: ignore[reportArgumentType]
