"""The fields of a spec, read from their annotations: type, bounds, unit, meaning, family."""

from dataclasses import fields, is_dataclass
from functools import cache
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

from annotated_types import DocInfo, Unit
from pydantic import TypeAdapter

from controllers.markers import EachOf, FileContent, OneOf, Rows


class FieldInfo(NamedTuple):
    """One field of a spec."""

    type: Any
    """Type without the annotations."""
    bounded: tuple[Any, ...]
    """Type and bounds of a plain value; empty for a part, which is a table."""
    family: OneOf | EachOf | None
    unit: str
    """Empty for a value without a unit."""
    doc: str
    columns: tuple[str, ...] = ()
    """Columns of a CSV file that can be given in place of the rows; empty for any other value."""
    content: FileContent | None = None
    """Reads a file that can be given in place of its content; None for any other value."""

    @property
    def is_plain(self) -> bool:
        """Whether it is a plain value; else it is a part, which is a table."""
        return bool(self.bounded)

    @property
    def adapter(self) -> TypeAdapter[Any] | None:
        """Validates a plain value; None for a part."""
        return _adapter(*self.bounded) if self.bounded else None


APART = "apart"
"""Key in the metadata of a field that is read and written apart from the others of its spec."""


@cache
def fields_of(spec: type) -> dict[str, FieldInfo]:
    """Return the fields of a spec, a dataclass, by name; without those that are read and written `APART`.

    Raises:
        PydanticUserError: A field of a class of a user's own has a type that cannot be validated.
    """
    hints = get_type_hints(spec, include_extras=True)
    found = {f.name: _info(hints[f.name]) for f in fields(spec) if APART not in f.metadata}
    if not is_ours(spec):
        for info in found.values():
            _ = info.adapter
    return found


def is_ours(spec: type) -> bool:
    """Return whether a class is one of heli_twin's own, whose types and defaults the tests have checked."""
    return spec.__module__.partition(".")[0] in ("controllers", "heli_twin")


def _info(hint: Any) -> FieldInfo:
    bare, *extras = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    family = next((e for e in extras if isinstance(e, OneOf | EachOf)), None)
    unit = next((e.unit for e in extras if isinstance(e, Unit)), "")
    text = next((e.documentation for e in extras if isinstance(e, DocInfo)), "")
    is_plain = family is None and not is_dataclass(bare)
    bounded = (bare, *(e for e in extras if not isinstance(e, Unit | DocInfo))) if is_plain else ()
    columns = next((e.columns for e in extras if isinstance(e, Rows)), ())
    content = next((e for e in extras if isinstance(e, FileContent)), None)
    return FieldInfo(bare, bounded, family, unit, text, columns, content)


@cache
def _adapter(*parts: Any) -> TypeAdapter[Any]:
    """The validator of a type with bounds; it is slow to make, and many fields have the same."""
    annotated: Any = Annotated
    return TypeAdapter[Any](annotated[parts] if parts[1:] else parts[0])
