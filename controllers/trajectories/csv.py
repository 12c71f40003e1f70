"""Fly a user's path, given as rows of time, position and heading."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, MaxLen, MinLen, Unit, doc

from controllers.flatness import FlatOutput
from controllers.jets import at_pace
from controllers.markers import Rows
from controllers.pace import paced, ride_clock, smooth_ride
from controllers.signals import Array
from controllers.splines import knot_motion, quintic, quintic_derivatives

Row = tuple[float, float, float, float, float]
"""Time (s), x, y, height (m) and heading (rad)."""


@dataclass(frozen=True, slots=True)
class Csv:
    """A smooth flight through every row at its time, along polynomials of degree five in the flat outputs.

    The rows are stored in the experiment, not the file name: a log can be flown again without the file. Times count
    from the first row's. Between two rows the heading turns the shorter way. Rows that begin or end in motion need a
    `ramp`.
    """

    kind: Literal["csv"] = "csv"
    rows: Annotated[
        tuple[Row, ...],
        MinLen(2),
        MaxLen(100_000),
        Rows(("t", "x", "y", "z", "yaw")),
        doc("t (s), x, y, height (m), heading (rad) each, or the path of a CSV file with columns t, x, y, z, yaw"),
    ] = (
        (0.0, 0.0, 0.0, 0.8, 0.0),
        (3.0, 0.6, 0.0, 1.0, 0.0),
        (6.0, 0.6, 0.6, 1.2, 1.5),
        (9.0, 0.0, 0.6, 1.0, 3.0),
        (12.0, 0.0, 0.0, 0.8, 3.0),
    )
    ramp: Annotated[
        float,
        Ge(0),
        Unit("s"),
        doc("time to gather speed and to stop, half of it extra; 0 keeps the rows' own time"),
    ] = 0.0

    def __post_init__(self) -> None:
        """Refuse rows that are not in order.

        Raises:
            ValueError: A time does not increase.
        """
        for i, (row, following) in enumerate(pairwise(self.rows)):
            if not following[0] > row[0]:
                raise ValueError(
                    f"rows[{i + 1}] has t = {following[0]} s after t = {row[0]} s: give every time once, in order"
                )

    def flat(self, t: Array) -> FlatOutput:
        """Return the flat outputs; after the last row the flight stays there."""
        times, points, motion = self._knots()
        pace = smooth_ride(t, float(times[-1]), self.ramp)
        return paced(quintic(pace[0], times, points, *motion), pace)

    @property
    def smoothness(self) -> int:
        """Up to the acceleration, at the rows."""
        return 2

    def derivatives(self, t: Array, highest: int) -> Array:
        """Return the flat outputs and their time derivatives."""
        knots = self._knots()
        clock = ride_clock(t, float(knots[0][-1]), self.ramp, highest)
        return at_pace(lambda reading, order: quintic_derivatives(reading, order, *knots), clock)

    def _knots(self) -> tuple[Array, Array, tuple[Array, Array]]:
        """Times (n,) and points (n, 4) of the rows, their velocities and accelerations."""
        rows = np.array(self.rows)
        times, points = rows[:, 0] - rows[0, 0], rows[:, 1:].copy()
        points[:, 3] = np.unwrap(points[:, 3])
        return times, points, knot_motion(times, points, rest=self.ramp == 0.0)
