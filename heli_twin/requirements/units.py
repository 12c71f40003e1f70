"""Units that a requirement may be written in."""

from math import pi
from typing import NamedTuple


class Unit(NamedTuple):
    """A unit of measurement."""

    quantity: str
    factor: float
    """Its size in the SI unit of the quantity."""


UNITS = {
    "m": Unit("length", 1.0),
    "cm": Unit("length", 1e-2),
    "mm": Unit("length", 1e-3),
    "rad": Unit("angle", 1.0),
    "deg": Unit("angle", pi / 180.0),
    "m/s": Unit("speed", 1.0),
    "cm/s": Unit("speed", 1e-2),
    "rad/s": Unit("angular rate", 1.0),
    "deg/s": Unit("angular rate", pi / 180.0),
    "s": Unit("time", 1.0),
    "ms": Unit("time", 1e-3),
    "V": Unit("voltage", 1.0),
    "%": Unit("share", 1e-2),
    "": Unit("share", 1.0),
}
"""By name as it is written. A share, such as a fraction of full stick, needs no unit."""


def converted(value: float, unit: str, to: str) -> float:
    """Return a value in another unit of the same quantity, exactly the same if the unit is the same."""
    return value if unit == to else value * (UNITS[unit].factor / UNITS[to].factor)


def units_of(quantity: str) -> list[str]:
    """Return the names of the units of a quantity."""
    return [name for name, unit in UNITS.items() if unit.quantity == quantity and name]
