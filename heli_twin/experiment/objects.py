"""Validation of an experiment that was made in Python.

The objects that are handed over are those that fly, also objects of the user's own classes: none is made again from
text. Only values change: NumPy's numbers and arrays become Python's.
"""

from dataclasses import is_dataclass, replace
from typing import Any

from pydantic import PydanticUserError

from controllers.markers import EachOf, Named
from heli_twin.experiment import Experiment
from heli_twin.experiment.families import members
from heli_twin.experiment.fields import FieldInfo, fields_of
from heli_twin.experiment.own import interface, own_class
from heli_twin.experiment.tree import kind_under, several
from heli_twin.experiment.values import ExperimentError, checked_value, plain


def validated(experiment: Any) -> Experiment:
    """Return the same experiment with its members sorted by name and Python's values in place of NumPy's.

    Raises:
        ExperimentError: Names the field, its value and the limit.
    """
    if type(experiment) is not Experiment:
        raise ExperimentError(f"this is of the class {type(experiment).__name__}: give an Experiment, as load() makes")
    return validated_parts(experiment, "")


def validated_parts(spec: Any, here: str) -> Any:
    """Return a spec after a check of all its fields.

    Args:
        spec: An experiment, or a part of one.
        here: Its dotted path, with a dot at its end; empty for the whole.

    Raises:
        ExperimentError: Names the field, its value and the limit.
    """
    changed: dict[str, Any] = {}
    for name, info in _fields(spec, here).items():
        value, path = getattr(spec, name), here + name
        if info.is_plain:
            new = checked_value(info, plain(value), path, type(spec))
        elif isinstance(info.family, EachOf):
            new = tuple(_each(key, member, info, f"{path}.{key}") for key, member in several(value, path).items())
        else:
            new = _part(value, info, path)
        # Not `!=`: it is True for 1 and 1.0, and an array has no single answer.
        if repr(new) != repr(value):
            changed[name] = new
    try:
        return replace(spec, **changed) if changed else spec
    except ValueError as error:
        raise ExperimentError(f"{here}{error}") from None


def _each(name: str, member: Any, info: FieldInfo, path: str) -> Any:
    member = _part(member, info, path)
    assert info.family is not None
    if not own_class(member, info):
        kind_under(name, member.kind, members(info.family.package), path)
    return member if name == member.kind else Named(name, member)


def _part(value: Any, info: FieldInfo, path: str) -> Any:
    """Validate a member of a family or a part with fields; one of a user's class must have what its family needs."""
    what = type(value).__name__
    if isinstance(value, type):
        raise ExperimentError(f"{path} is the class {value.__name__}: give an object of it, {value.__name__}()")
    if own_class(value, info):
        if info.family is None and not isinstance(value, info.type):
            raise ExperimentError(f"{path} is of the class {what}: it has to be a {info.type.__name__}")
        if not (is_dataclass(value) and _frozen(value)):
            raise ExperimentError(f"{path} is of the class {what}: make it a dataclass that is frozen, as members are")
        needs = sorted({"kind", *interface(info)}) if info.family else []
        missing = [name for name in needs if not hasattr(value, name)]
        if needs and not isinstance(getattr(value, "kind", None), str):
            missing = ["kind that is a text"]
        if missing:
            raise ExperimentError(
                f"{path} is of the class {what}, which has no {missing[0]}: it needs {', '.join(needs)}"
            )
    return validated_parts(value, f"{path}.")


def _frozen(spec: Any) -> bool:
    return spec.__dataclass_params__.frozen


def _fields(spec: Any, here: str) -> dict[str, FieldInfo]:
    try:
        return fields_of(type(spec))
    except (TypeError, NameError, PydanticUserError) as error:
        raise ExperimentError(
            f"{here[:-1]} is of the class {type(spec).__name__}, which has a field of an unsupported type"
            f" ({str(error).splitlines()[0][:100]}): use numbers, texts and tuples of them"
        ) from None
