"""The envelope of a calibration: what its flights covered. Beyond it, its twin is a guess."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from heli_twin.experiment.toml_file import table_in
from heli_twin.experiment.values import ExperimentError
from heli_twin.terminal_text import clean

MARGIN = 0.1
"""Share of a range by which a flight may leave it unnoticed: gusts scatter as much."""
STICKS = ("pitch", "roll", "thrust", "yaw")


class Envelope(NamedTuple):
    """Ranges over some flights; what is not known is None."""

    speed: float | None = None
    """Greatest in the plane, m/s."""
    climb: float | None = None
    """Greatest vertical speed, up or down, m/s."""
    yaw_rate: float | None = None
    """Greatest, rad/s."""
    tilt: float | None = None
    """Greatest, rad."""
    height: tuple[float, float] | None = None
    """Lowest and highest, m."""
    stick_low: tuple[float, float, float, float] | None = None
    """Of full stick; all but a thousandth of the time the sticks are between these."""
    stick_high: tuple[float, float, float, float] | None = None
    duration: float | None = None
    """Of the longest flight, s."""

    def plain(self) -> dict[str, Any]:
        """The same for TOML and JSON, to four digits, without what is not known."""
        return {
            name: [_short(v) for v in value] if isinstance(value, tuple) else _short(value)
            for name, value in self._asdict().items()
            if value is not None
        }

    def left_by(self, flight: "Envelope") -> list[str]:
        """Return a phrase for each range that a flight leaves."""
        return list(self._left_by(flight))

    def _left_by(self, flight: "Envelope") -> Iterator[str]:
        for name, unit, factor, what in _GREATEST:
            most, reached = getattr(self, name), getattr(flight, name)
            if most is not None and reached is not None and reached > most * (1.0 + MARGIN):
                yield f"{what} {factor * reached:.3g} {unit} (covered: {factor * most:.3g})"
        if self.height and flight.height:
            (low, high), slack = self.height, MARGIN * (self.height[1] - self.height[0])
            if flight.height[0] < low - slack or flight.height[1] > high + slack:
                yield f"height {flight.height[0]:.2f} to {flight.height[1]:.2f} m (covered: {low:.2f} to {high:.2f})"
        if self.stick_low and self.stick_high and flight.stick_low and flight.stick_high:
            for i, name in enumerate(STICKS):
                low, high = self.stick_low[i], self.stick_high[i]
                slack = MARGIN * (high - low)
                if flight.stick_low[i] < low - slack or flight.stick_high[i] > high + slack:
                    yield (
                        f"{name} stick {flight.stick_low[i]:.2f} to {flight.stick_high[i]:.2f}"
                        f" (covered: {low:.2f} to {high:.2f})"
                    )


_GREATEST = (
    ("speed", "m/s", 1.0, "speed up to"),
    ("climb", "m/s", 1.0, "vertical speed up to"),
    ("yaw_rate", "rad/s", 1.0, "yaw rate up to"),
    ("tilt", "deg", math.degrees(1.0), "tilt up to"),
    ("duration", "s", 1.0, "a flight of"),
)
_LENGTHS = {"height": 2, "stick_low": 4, "stick_high": 4}
"""Numbers of each range that is not one number."""


def _short(value: float) -> float:
    return float(f"{value:.4g}")


def envelope_in(source: str | None) -> Envelope | None:
    """Return the envelope that a calibration says; None for another file, a preset or nothing.

    Raises:
        ExperimentError: The file cannot be read, or its envelope is none; the message names the entry.
    """
    table = table_in(source, "envelope") if source else {}
    return envelope_of(table, f"{clean(source, 200)}: envelope") if table else None


def envelope_of(table: Any, path: str) -> Envelope:
    """Return the envelope that a table says.

    Args:
        table: Of a TOML file.
        path: Where it stands, for messages.

    Raises:
        ExperimentError: It is none; the message names the entry.
    """
    if not isinstance(table, dict):
        raise ExperimentError(f"{path} = {clean(table, 60)} is not a table")
    unknown = next((name for name in table if name not in Envelope._fields), None)
    if unknown is not None:
        raise ExperimentError(f"{path}.{clean(unknown, 40)} is no range. Available: {', '.join(Envelope._fields)}")
    return Envelope(**{name: _range(f"{path}.{name}", name, value) for name, value in table.items()})


def _range(path: str, name: str, value: Any) -> Any:
    count = _LENGTHS.get(name)
    numbers: list[Any] = value if isinstance(value, list) else [value]
    are_numbers = all(type(n) in (int, float) and math.isfinite(n) for n in numbers)
    if not are_numbers or isinstance(value, list) != bool(count) or len(numbers) != (count or 1):
        raise ExperimentError(
            f"{path} = {clean(value, 60)}: write {f'a list of {count} numbers' if count else 'a number'}"
        )
    return tuple(map(float, numbers)) if count else float(numbers[0])
