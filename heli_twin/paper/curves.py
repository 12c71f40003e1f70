"""The paper's figures of single flights: Figs. 3, 4 and 5, and the trajectories it names without a figure."""

from typing import NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.metrics.tracking import tracking_error
from heli_twin.paper.cases import CASES
from heli_twin.paper.claims import CM, SOLVE_MS
from heli_twin.paper.comparison import DEGREES
from heli_twin.paper.flights import Flights
from heli_twin.recording import Log
from heli_twin.recording.log import Timings
from heli_twin.reporting.figure import Curve, Figure, Panel
from heli_twin.reporting.words import number

STEPS_PER_POINT = 2
"""Control steps between two points of a curve: 40 ms, which no eye can see."""
YAW = 3
TIME_LABEL = "time (s)"


class Shown(NamedTuple):
    """A figure, and the cases whose first flights are the curves in it."""

    figure: Figure
    cases: tuple[str, ...]


def error_of(log: Log) -> tuple[Array, Array]:
    """Times (n,), s, and errors x y z (cm) yaw (deg) (n, 4), for the eye."""
    tracked = tracking_error(log)
    return tracked.time[::STEPS_PER_POINT], (tracked.error * [CM, CM, CM, DEGREES])[::STEPS_PER_POINT]


def _flown(log: Log, column: int) -> tuple[Array, Array, Array]:
    """Times (n,), a coordinate x y z (m) or yaw (deg) as flown (n,), and as planned (n,)."""
    time, error = error_of(log)
    _, _, of_reference = np.intersect1d(log.truth.stamp, log.reference.stamp, return_indices=True)
    planned = log.reference.x[of_reference][::STEPS_PER_POINT, column]
    if column == YAW:
        return time, DEGREES * planned + error[:, column], DEGREES * planned
    return time, planned + error[:, column] / CM, planned


def circle_figure(flights: Flights, name: str, title: str, cases: tuple[str, ...]) -> Shown:
    """Position, heading and their errors of circles: Figs. 3 and 5."""
    flown: list[Panel] = []
    errors: list[Panel] = []
    for column, coordinate, unit, small in (
        (0, "x", "m", "cm"),
        (1, "y", "m", "cm"),
        (YAW, "heading", "deg", "deg"),
    ):
        above: list[Curve] = []
        below: list[Curve] = []
        for place, case in enumerate(cases):
            time, position, planned = _flown(flights.log(case), column)
            if place == 0:
                above.append(Curve("reference", time, planned, style="dashes", color=6))
            above.append(Curve(_label(case), time, position, style="steps", color=place))
            time, error = error_of(flights.log(case))
            below.append(Curve(_label(case), time, error[:, column], style="steps", color=place))
        flown.append(Panel(coordinate, TIME_LABEL, f"{coordinate} ({unit})", above))
        errors.append(Panel(f"error in {coordinate}", TIME_LABEL, f"error ({small})", below))
    parts = [f"{_label(case)} {' / '.join(_maxima(flights, case))} cm" for case in cases]
    sentence = (
        f"Position, heading and their errors, first seed. Largest error in x / y after the start: {', '.join(parts)}."
    )
    return Shown(Figure(name, title, sentence, [*flown, *errors]), cases)


def _label(case: str) -> str:
    return "MPC on the twin" if case == "circle" else CASES[case].label


def _maxima(flights: Flights, case: str) -> list[str]:
    return [number(CM * float(flights.values(case, f"max_abs_error.{axis}")[0]), 2) for axis in "xy"]


def hover_figure(flights: Flights) -> Shown:
    """Hover and its inputs with their offset: Fig. 4."""
    log = flights.log("hover")
    time, error = error_of(log)
    panels = [
        Panel(axis, TIME_LABEL, f"{axis} (cm)", [Curve("position", time, error[:, column], style="steps", color=0)])
        for column, axis in enumerate("xy")
    ]
    time, u = np.asarray(1e-9 * log.sent.time, np.float64), log.sent.u
    means = [float(flights.values("hover", f"mean.u_{axis}")[0]) for axis in "xy"]
    for column, axis in enumerate("xy"):
        marks = [
            Curve("input", time, u[:, column], style="steps", color=2),
            Curve("its mean: the offset", time[[0, -1]], np.full(2, means[column]), style="dashes", color=1),
        ]
        panels.append(Panel(f"u_{axis}", TIME_LABEL, f"u_{axis} (full stick)", marks))
    sentence = (
        f"Position about the hover point, first seed, largest {' / '.join(_maxima(flights, 'hover'))} cm in x / y; "
        f"a steady push offsets the inputs by {means[0]:.3f} / {means[1]:.3f}."
    )
    return Shown(Figure("fig4", "Fig. 4: hover on the twin", sentence, panels), ("hover",))


def others_figure(flights: Flights) -> Shown:
    """Errors of both controllers on the trajectories that the paper names without a figure."""
    trajectories = (("pirouette", "pirouette"), ("wheel", "ferris wheel"), ("turning", "pirouette circle"))
    positions: list[Panel] = []
    headings: list[Panel] = []
    for name, title in trajectories:
        lengths: list[Curve] = []
        angles: list[Curve] = []
        for place, (tail, word) in enumerate((("", "MPC"), ("_pid", "PID, feedback only"))):
            time, error = error_of(flights.log(name + tail))
            distance = np.linalg.norm(error[:, :YAW], axis=1)
            lengths.append(Curve(word, time, distance, style="steps", color=place))
            angles.append(Curve(word, time, error[:, YAW], style="steps", color=place))
        positions.append(Panel(title, TIME_LABEL, "position error (cm)", lengths))
        headings.append(Panel("", TIME_LABEL, "heading error (deg)", angles))
    sentence = "First seed. By feedback only the PID knows nothing of the planned inputs and lags behind."
    figure = Figure("others", "The other trajectories, MPC and PID", sentence, [*positions, *headings])
    return Shown(figure, tuple(name + tail for name, _ in trajectories for tail in ("", "_pid")))


def times_figure(timing: Timings) -> Figure:
    """Distribution of the measured times of one flight: different every time."""
    shares = np.linspace(0.0, 100.0, 401)
    curves: list[Curve] = []
    for place, (label, ns) in enumerate((("solve", timing.solve_ns), ("whole step", timing.control_step_ns))):
        curves.append(
            Curve(label, np.percentile(1e-6 * ns, shares).astype(np.float64), shares, style="steps", color=place)
        )
    for limit in SOLVE_MS:
        ends = np.full(2, limit)
        curves.append(Curve("paper", ends, np.array([0.0, 100.0]), style="dashes", color=7))
    panel = Panel("", "ms", "% of steps below", curves, x_log=True)
    sentence = (
        "QP solve and whole control step of one flight on this host, measured anew each time; dashed, the paper's."
    )
    return Figure("solve-times", "Distribution of the computing times", sentence, [panel])
