"""Beyond the paper: hover with its detailed model, beside its weights, a Riccati terminal cost and the LQG bound.

The bound is computed, not flown: see `heli_twin.tuning.lqg_bound`.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from controllers.detailed_model import DetailedModel
from controllers.laws.detailed_mpc import DetailedMpc
from controllers.signals import Array
from heli_twin.paper.cases import ATTITUDE, ATTITUDES, CASES, FEW_SEEDS, HOVERED, at_attitude
from heli_twin.paper.claims import CM
from heli_twin.paper.curves import Shown
from heli_twin.paper.flights import Flights
from heli_twin.reporting.figure import Curve, Figure, Panel, Table
from heli_twin.reporting.intervals import Interval, median_interval, paired_interval
from heli_twin.reporting.words import interval, number
from heli_twin.tuning.lqg_bound import lqg_bounds

RHOS = (1.0, 0.3, 0.1, 0.03, 0.01, 0.003, 0.001, 0.0001)
"""Weights of the points of the bound, from little to much stick."""
LABS = {"lab_simple": HOVERED, "lab": tuple(f"real_{case}" for case in HOVERED)}
"""The cases of hover in each lab: the paper's weights, Riccati, the detailed model."""
LAW_NAMES = ("paper's weights", "Riccati terminal weight", "detailed model")


class BoundCurve(NamedTuple):
    """The least error over the stick that it takes, both increasing with the number of the point."""

    stick: Array
    error: Array
    """m."""

    def at(self, stick: float) -> float:
        """The least error with as much stick, m; NaN beyond the computed points."""
        if not self.stick[0] <= stick <= self.stick[-1]:
            return np.nan
        return float(np.exp(np.interp(stick, self.stick, np.log(self.error))))


@cache
def bound_curve(model: DetailedModel, axis: int) -> BoundCurve:
    """The bound of one axis of a helicopter."""
    found = lqg_bounds(model, axis, RHOS)
    return BoundCurve(np.array([bound.stick for bound in found]), np.array([bound.error for bound in found]))


def helicopter(cases: tuple[str, ...]) -> DetailedModel:
    """The believed model of the detailed law, which in these labs is that of the helicopter and its gusts."""
    law = CASES[cases[-1]].experiment(0, 1.0).controller
    assert isinstance(law, DetailedMpc)
    return law.model


def beyond_table(flights: Flights) -> Table:
    """The table of laws in hover, in both labs."""
    rows = [
        [lab, name, *_largest(flights, lab, case), _compared(flights, case, cases[0]), _others(flights, case)]
        for lab, cases in LABS.items()
        for name, case in zip(LAW_NAMES, cases, strict=True)
    ]
    at = " / ".join(str(frequency) for frequency in sorted((*ATTITUDES, ATTITUDE)))
    sentence = (
        "Hover, the same seeds for every law: median of the largest error of a flight, the stick it takes, and how many"
        " times the LQG bound at the same stick that is: the error of the linear controller with the least mean square"
        " error against these gusts and delays, which knows everything exactly."
        " Then the mean difference of the largest position error from the"
        f" paper's weights, seed by seed, and that error with pitch and roll at {at} rad/s (first {FEW_SEEDS} seeds at"
        " the others)."
    )
    header = [
        *("lab", "law", "largest error x / y, cm", "stick rms about its mean x / y", "times the bound x / y"),
        *("less than the paper's weights, cm", f"at {at} rad/s, cm"),
    ]
    return Table("Beyond the paper: the detailed model", sentence, header, rows)


def beyond_figure(flights: Flights) -> Shown:
    """Error against stick: the bound as a line, the flown laws as points with their intervals."""
    panels: list[Panel] = []
    for lab, cases in LABS.items():
        for axis, name in enumerate("xy"):
            bound = bound_curve(helicopter(cases), axis)
            marks = [Curve("LQG bound", bound.stick, CM * bound.error, color=6)]
            for place, (law, case) in enumerate(zip(LAW_NAMES, cases, strict=True)):
                marks += _point(law, stick(flights, case, name), largest_error(flights, case, name), place)
            panels.append(Panel(f"{lab}, {name}", "stick rms about its mean", f"largest error in {name} (cm)", marks))
    sentence = (
        "Largest error of a hover of 28 s, median with its 95 % interval, against the stick that it takes. The line is"
        " the least error for each amount of stick; its points differ in the weight on the stick."
    )
    figure = Figure("lqg-bound", "How far from the bound: error against stick", sentence, panels)
    return Shown(figure, tuple(case for cases in LABS.values() for case in cases))


def largest_error(flights: Flights, case: str, axis: str) -> Interval:
    """Median over the seeds of the largest error, m."""
    return median_interval(flights.values(case, f"max_abs_error.{axis}"))


def stick(flights: Flights, case: str, axis: str) -> float:
    """Root mean square of the input of an axis about its mean, over all seeds."""
    return float(np.sqrt(np.mean(flights.values(case, f"std.u_{axis}") ** 2)))


def _point(label: str, at: float, found: Interval, color: int) -> list[Curve]:
    marks = [Curve(label, np.array([at]), np.array([CM * found.value]), color=color)]
    if np.isfinite([found.low, found.high]).all():
        ends = CM * np.array([found.low, found.high])
        marks.append(Curve("", np.full(2, at), ends, style="steps", color=color))
    return marks


def _largest(flights: Flights, lab: str, case: str) -> list[str]:
    errors = [largest_error(flights, case, axis) for axis in "xy"]
    sticks = [stick(flights, case, axis) for axis in "xy"]
    bounds = [bound_curve(helicopter(LABS[lab]), axis).at(s) for axis, s in enumerate(sticks)]
    return [
        " / ".join(interval(error, CM) for error in errors),
        " / ".join(number(s, 2) for s in sticks),
        " / ".join(number(error.value / bound) for error, bound in zip(errors, bounds, strict=True)),
    ]


def _compared(flights: Flights, case: str, paper: str) -> str:
    if case == paper:
        return "-"
    name = "max_abs_error.position"
    return interval(paired_interval(flights.values(paper, name), flights.values(case, name)), CM)


def _others(flights: Flights, case: str) -> str:
    """The median of the largest position error at each frequency of attitude, where it was flown."""
    cases = [at_attitude(case, frequency) for frequency in sorted((*ATTITUDES, ATTITUDE))]
    if not set(cases) <= CASES.keys():
        return "-"
    return " / ".join(number(CM * median_interval(flights.values(c, "max_abs_error.position")).value) for c in cases)
