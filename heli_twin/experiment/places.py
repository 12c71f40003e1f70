"""Finds the member of a family, or the field for the content of a file, at a dotted path of an experiment."""

from collections.abc import Iterator

from controllers.markers import EachOf, FileContent
from heli_twin.experiment import Experiment
from heli_twin.experiment.families import members
from heli_twin.experiment.fields import FieldInfo, fields_of


def family_at(path: str, spec: type = Experiment, ends: tuple[str, ...] = ("",)) -> str:
    """Return the family's package of the member at a dotted path, for any kinds of the members above it.

    Args:
        path: Dotted path.
        spec: Class of the table in which it begins.
        ends: What may follow the member in the path: `kind` is its kind.

    Returns:
        The package; empty if no member stands there.
    """
    return next((info.family.package for info, rest in _led_to(path, spec) if info.family and rest in ends), "")


def content_field_at(path: str) -> FileContent | None:
    """Return how the field at a path reads its file, for any kinds of the members above it; None if it has none."""
    return next((info.content for info, rest in _led_to(path, Experiment) if info.content and not rest), None)


def _led_to(path: str, spec: type) -> Iterator[tuple[FieldInfo, str]]:
    """Yield the plain fields and the members that a path leads to or through, outermost first, and the rest of it."""
    key, _, rest = path.partition(".")
    info = fields_of(spec).get(key)
    if info is None:
        return
    if isinstance(info.family, EachOf):
        _, _, rest = rest.partition(".")
    if info.is_plain or info.family:
        yield info, rest
    if rest and info.family:
        for member in members(info.family.package).values():
            yield from _led_to(rest, member)
    elif rest and not info.is_plain:
        yield from _led_to(rest, info.type)
