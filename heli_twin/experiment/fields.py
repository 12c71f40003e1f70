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
    adapter: TypeAdapter[Any] | None
    """Validates a plain value; None for a part, which is a table."""
    family: OneOf | EachOf | None
    unit: str
    """Empty for a value without a unit."""
    doc: str
    columns: tuple[str, ...] = ()
    """Columns of a CSV file that can be given in place of the rows; empty for any other value."""
    content: FileContent | None = None
    """Reads a file that can be given in place of its content; None for any other value."""


APART = "apart"
"""Key in the metadata of a field that is read and written apart from the others of its spec."""


@cache
def fields_of(spec: type) -> dict[str, FieldInfo]:
    """Return the fields of a spec, a dataclass, by name; without those that are read and written `APART`."""
    hints = get_type_hints(spec, include_extras=True)
    return {f.name: _info(hints[f.name]) for f in fields(spec) if APART not in f.metadata}


def _info(hint: Any) -> FieldInfo:
    bare, *extras = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    family = next((e for e in extras if isinstance(e, OneOf | EachOf)), None)
    unit = next((e.unit for e in extras if isinstance(e, Unit)), "")
    text = next((e.documentation for e in extras if isinstance(e, DocInfo)), "")
    plain = family is None and not is_dataclass(bare)
    columns = next((e.columns for e in extras if isinstance(e, Rows)), ())
    content = next((e for e in extras if isinstance(e, FileContent)), None)
    adapter = _adapter(bare, *(e for e in extras if not isinstance(e, Unit | DocInfo))) if plain else None
    return FieldInfo(bare, adapter, family, unit, text, columns, content)


@cache
def _adapter(*parts: Any) -> TypeAdapter[Any]:
    """The validator of a type with bounds; it is slow to make, and many fields have the same."""
    annotated: Any = Annotated
    return TypeAdapter[Any](annotated[parts] if parts[1:] else parts[0])
