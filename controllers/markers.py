"""Annotations of spec fields, read where text is converted to values. They do not affect a flight."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class OneOf:
    """Marks a field whose value is one member of a family."""

    package: str
    """The package or module that contains the family, one file a member."""


@dataclass(frozen=True, slots=True)
class EachOf:
    """Marks a field that holds any number of members of a family."""

    package: str


@dataclass(frozen=True, slots=True)
class Rows:
    """Marks a field that contains rows of numbers: text may name a CSV file with these columns instead."""

    columns: tuple[str, ...]
