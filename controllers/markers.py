"""What the annotations of a spec tell the edge where text becomes a value. They change nothing in flight."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class OneOf:
    """Marks a field whose value is any one member of the family that lives in a package or module."""

    package: str


@dataclass(frozen=True, slots=True)
class Rows:
    """Marks a field that holds rows of numbers: text may name a CSV file with these columns instead."""

    columns: tuple[str, ...]
