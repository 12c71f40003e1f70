"""Annotations of spec fields, read where text is converted to values, and the names of several members of a family."""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

Member = TypeVar("Member")


@dataclass(frozen=True, slots=True)
class OneOf:
    """Marks a field whose value is one member of a family."""

    package: str
    """The package or module that contains the family, one file a member."""


@dataclass(frozen=True, slots=True)
class EachOf:
    """Marks a field that holds any number of members of a family, each under a name: `by_name` says it."""

    package: str


@dataclass(frozen=True, slots=True)
class Rows:
    """Marks a field that contains rows of numbers: text may name a CSV file with these columns instead."""

    columns: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FileContent:
    """Marks a field that holds a text: where a file is named instead, its content becomes the value."""

    read: Callable[[Path], str]
    """Returns the content; raises OSError, or ValueError with a sentence that begins with the name of the file."""


@dataclass(frozen=True, slots=True)
class Named(Generic[Member]):
    """A member with a name of its own in a field of `EachOf`, so that there can be two of one kind."""

    name: str
    member: Member


def by_name(several: Iterable[Member | Named[Member]]) -> dict[str, Member]:
    """Return the members in a field of `EachOf` by their names, in alphabetical order.

    A member without a name of its own is named by its kind; the second of a kind is `kind_2`, the third `kind_3`.

    Raises:
        ValueError: Two members have the same name, or a name is not valid.
    """
    named: dict[str, Member] = {}
    unnamed: list[Member] = []
    for each in several:
        if not isinstance(each, Named):
            unnamed.append(each)
        elif each.name in named:
            raise ValueError(f"two members are named '{each.name}': give each its own name")
        else:
            named[checked_name(each.name)] = cast("Member", each.member)
    for member in unnamed:
        kind = checked_name(getattr(member, "kind", None))
        names = (kind if i == 1 else f"{kind}_{i}" for i in count(1))
        named[next(name for name in names if name not in named)] = member
    return dict(sorted(named.items()))


def checked_name(name: Any) -> str:
    """Return the name of a member: a key in TOML and in dotted paths.

    Raises:
        ValueError: It is not a name.
    """
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]{0,39}", name):
        raise ValueError(f"{str(name)[:40]!r} is not a name: take a letter, then up to 39 letters, digits, _ and -")
    return name
