"""Numbers and names for people: centimetres, degrees, milliseconds; units of fields."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from controllers.markers import EachOf
from heli_twin.experiment import Experiment
from heli_twin.experiment.families import members
from heli_twin.experiment.fields import fields_of
from heli_twin.reporting.intervals import Interval

NAMES = {
    "rmse": "RMS error",
    "mse": "mean squared error",
    "max_abs_error": "largest error",
    "p95": "95 % error",
    "bias": "mean error",
    "spread": "scatter of the error",
    "sustained": "sustained error",
    "variation": "stick travel",
    "effort": "stick effort",
    "saturated": "time at a stick limit",
    "least_planned": "least distance of plans",
    "missing": "helicopters not at their goals",
    "planning_ms": "turn of a planner",
}
LENGTHS = ("rmse", "max_abs_error", "p95", "bias", "spread", "sustained")
LARGER_IS_BETTER = ("least_distance", "least_distance_in_plane", "least_planned", "arrived", "real_time_factor")
UNITS = {
    "duration": ("s", 1.0),
    "settling": ("s", 1.0),
    "phase_lag": ("ms", 1e3),
    "settling_time": ("s", 1.0),
    "overshoot": ("%", 100.0),
    "saturated": ("%", 100.0),
    "effort": ("stick\u00b2", 1.0),
    "variation": ("sticks/s", 1.0),
    "time_to_goal": ("s", 1.0),
    "stuck": ("s", 1.0),
    "least_distance": ("m", 1.0),
    "least_distance_in_plane": ("m", 1.0),
    "least_planned": ("m", 1.0),
}

STORED_UNITS = {
    "excess": "share of the limit",
    "phase_lag": "s",
    "settling_time": "s",
    "overshoot": "share of the step",
    "tilt.max": "rad",
    "flown": "s",
    "wall_time": "s",
    "settling": "s",
    "effort": "full stick squared",
    "variation": "full stick/s",
    "time_to_goal": "s",
    "stuck": "s",
    "least_distance": "m",
    "least_distance_in_plane": "m",
    "least_planned": "m",
    "saturated": "share of the time",
}
"""Units of further columns of a study's results."""


class Scale(NamedTuple):
    """Name, unit and factor with which a quantity is shown."""

    name: str
    unit: str
    factor: float

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name}, {self.unit}" if self.unit else self.name


def metric(name: str) -> Scale:
    """Return name, unit and factor with which a metric is shown."""
    stem, _, axis = name.partition(".")
    text = _name(NAMES.get(stem, stem.replace("_", " ")), axis)
    if stem in LENGTHS:
        return Scale(text, "deg", 180 / np.pi) if axis == "yaw" else Scale(text, "cm", 100.0)
    if stem == "mse":
        return Scale(text, "deg\u00b2", (180 / np.pi) ** 2) if axis == "yaw" else Scale(text, "cm\u00b2", 1e4)
    if stem in UNITS:
        return Scale(text, *UNITS[stem])
    if stem == "excess":
        return Scale(f"excess over requirement {axis}", "%", 100.0)
    if stem.endswith("_ms"):
        return Scale(_name(NAMES.get(stem, stem[:-3].replace("_", " ")), axis), "ms", 1.0)
    return Scale("largest tilt", "deg", 180 / np.pi) if name == "tilt.max" else Scale(text, "", 1.0)


def si_unit(column: str) -> str:
    """The unit in which a column of a study's results is stored: of a metric, or of a swept field."""
    stem, _, axis = column.partition(".")
    if stem in LENGTHS or stem == "mse":
        power = "^2" if stem == "mse" else ""
        return ("rad" if axis == "yaw" else "m") + power
    if stem.endswith("_ms"):
        return "ms"
    if column in STORED_UNITS or stem in STORED_UNITS:
        return STORED_UNITS.get(column, STORED_UNITS.get(stem, ""))
    return field(column).unit


def _name(stem: str, axis: str) -> str:
    if axis == "position":
        return stem.replace("error", "position error")
    return f"{stem} in {axis}" if axis in ("x", "y", "z", "yaw") else f"{stem} {axis}".strip()


def field(path: str, values: Sequence[float] = ()) -> Scale:
    """Return the scale of an axis: small times in ms, small masses in g."""
    unit = _unit(Experiment, path.split(".")) or _unit_in_room(path)
    largest = max((abs(value) for value in values), default=np.inf)
    if unit == "s" and largest < 0.5:
        return Scale(path, "ms", 1e3)
    return Scale(path, "g", 1e3) if unit == "kg" and largest < 1 else Scale(path, "" if unit == "1" else unit, 1.0)


def _unit_in_room(path: str) -> str:
    """The unit of a field of several helicopters, or of one of them."""
    from heli_twin.experiment.several import Several

    first, *rest = path.split(".")
    return _unit(Experiment, rest[1:]) if first == "ships" and rest[1:] else _unit(Several, [first, *rest])


def _unit(spec: type, keys: list[str]) -> str:
    """The unit of the field at a path; of any member of a family that has it."""
    part = fields_of(spec).get(keys[0])
    if part is None:
        return ""
    rest = keys[1:]
    kinds = members(part.family.package) if part.family else {}
    if isinstance(part.family, EachOf) and rest:
        # A member has the name of its kind, unless it is named otherwise.
        kinds = {rest[0]: kinds[rest[0]]} if rest[0] in kinds else kinds
        rest = rest[1:]
    if not rest:
        return part.unit
    if part.is_plain:
        # A value has no fields; another member of the family has a table of this name.
        return ""
    inner = kinds.values() if part.family else [part.type]
    return next((unit for kind in inner if (unit := _unit(kind, rest))), "")


def number(value: float, digits: int = 3) -> str:
    """A number with some significant digits; `-` for a non-finite one."""
    return "-" if not np.isfinite(value) else f"{value:.{digits}g}"


def interval(found: Interval, factor: float = 1.0, unit: str = "") -> str:
    """`1.23 [1.1, 1.4] cm`; `1.23 cm (one seed)` without an interval."""
    if not np.isfinite(found.value):
        return "-"
    text = number(found.value * factor)
    if found.low < found.high:
        text += f" [{number(found.low * factor)}, {number(found.high * factor)}]"
    return f"{text} {unit}".rstrip() + few_seeds(found)


def percent(found: Interval) -> str:
    """`3.2 % [1.1, 7.4]`; `3.2 % (one seed)` without an interval."""
    if not np.isfinite(found.value):
        return "-"
    span = f" [{100 * found.low:.2g}, {100 * found.high:.2g}]" if np.isfinite(found.low) else ""
    return f"{100 * found.value:.3g} %{span}{few_seeds(found)}"


def few_seeds(found: Interval) -> str:
    """The reason for a missing interval."""
    if np.isfinite([found.low, found.high]).all():
        return ""
    return " (one seed)" if found.n == 1 else f" ({found.n} seeds: too few for an interval)"


def listed(words: Sequence[str]) -> str:
    """`a, b and c`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else "nothing"
