"""What `help` says of a spec: its fields with default, unit and meaning, in place of a signature of annotations."""

from dataclasses import MISSING, Field, fields, is_dataclass
from inspect import Parameter, Signature, cleandoc
from textwrap import fill
from typing import Annotated, Any, TypeVar, get_args, get_origin

from annotated_types import DocInfo, Unit

from controllers.markers import EachOf, OneOf

T = TypeVar("T", bound=type)

_WIDTH = 100


def explained(spec: T) -> T:
    """Add the fields of a dataclass to its docstring, and shorten the signature that `help` shows."""
    parameters = [Parameter(f.name, Parameter.POSITIONAL_OR_KEYWORD, default=_Shown(f)) for f in _given(spec)]
    signature = Signature(parameters)
    lines = (_wrapped(f"    {_line(f)}") for f in _given(spec))
    spec.__doc__ = "\n".join([cleandoc(spec.__doc__ or ""), "", "Fields:", *lines, ""])
    spec.__signature__ = signature  # pyright: ignore[reportAttributeAccessIssue]
    spec.__init__.__signature__ = signature  # pyright: ignore[reportAttributeAccessIssue, reportFunctionMemberAccess]
    return spec


def _wrapped(line: str) -> str:
    """Most lines are short, and `fill` is slow: it would take a tenth of the start of a command."""
    return line if len(line) <= _WIDTH else fill(line.strip(), _WIDTH, initial_indent="    ", subsequent_indent=" " * 8)


class _Shown:
    """A default value as a signature shows it."""

    def __init__(self, given: Field[Any]) -> None:
        self._text = _default(given)

    def __repr__(self) -> str:
        return self._text


def _given(spec: type) -> tuple[Field[Any], ...]:
    return fields(spec) if is_dataclass(spec) else ()


def _line(given: Field[Any]) -> str:
    """`duration = 30.0 s: how long to fly`."""
    _, *notes = get_args(given.type) if get_origin(given.type) is Annotated else (given.type,)
    unit = next((f" {note.unit}" for note in notes if isinstance(note, Unit) and note.unit != "1"), "")
    text = next((f": {note.documentation}" for note in notes if isinstance(note, DocInfo)), "")
    family = next((f" (any of {note.package})" for note in notes if isinstance(note, OneOf | EachOf)), "")
    return f"{given.name} = {_default(given)}{unit}{text}{family}"


def _default(given: Field[Any]) -> str:
    """A default as a short text: of a part its class, of a list the classes."""
    if given.default_factory is not MISSING:
        value = given.default_factory()
    elif given.default is MISSING:
        return "..."
    else:
        value = given.default
    return _short(value)


def _short(value: Any) -> str:
    if isinstance(value, tuple) and any(map(is_dataclass, value)):
        return f"({', '.join(map(_short, value))})"
    return f"{type(value).__name__}()" if is_dataclass(value) else repr(value)
