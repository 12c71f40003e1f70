"""The paper's figures from our flights, as values that `studies.report.drawing` draws."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.metrics import tracking_error
from heli_twin.paper_claims import CM, DEGREES
from heli_twin.paper_flights import CASES, WEAK, Flights
from heli_twin.recording import Log
from heli_twin.recording.log import Timings
from heli_twin.studies.inference import mean_interval
from heli_twin.studies.report.figure import Curve, Dots, Figure, Panel
from heli_twin.studies.report.words import metric, number

STATES = ("x", "y", "z", "yaw")
SHOWN_EVERY = 2
"""Control steps between two points of a curve: 40 ms, which no eye can tell."""


class Shown(NamedTuple):
    """A figure, and the cases whose first flights are the curves in it."""

    figure: Figure
    cases: tuple[str, ...]


def figures(flights: Flights) -> Iterator[Shown]:
    """All figures but that of measured times."""
    yield _circle(
        flights,
        "fig3",
        "Fig. 3: a circle in simulation, and on the twin",
        ("simulated", "simulated_undelayed", "circle"),
    )
    yield _hover(flights)
    yield _circle(flights, "fig5", "Fig. 5: a circle on the twin", ("circle",))
    yield _average_errors(flights)
    yield _what_it_takes(flights)
    yield _heading(flights)
    yield _height(flights)
    yield _coupling(flights)
    yield _others(flights)


def _time(log: Log) -> tuple[Array, Array]:
    """Times (n,), s, and errors x y z (cm) yaw (deg) (n, 4)."""
    found = tracking_error(log)
    return found.time[::SHOWN_EVERY], (found.error * [CM, CM, CM, DEGREES])[::SHOWN_EVERY]


def _flown(log: Log, column: int) -> tuple[Array, Array, Array]:
    """Time, a coordinate x y z (m) or yaw (deg) as flown, and as planned."""
    time, error = _time(log)
    scale = DEGREES if column == 3 else 1.0
    # The plan counts turns, the truth may not.
    planned = scale * log.reference.x[: SHOWN_EVERY * len(time) : SHOWN_EVERY, column]
    return time, planned + error[:, column] / (1.0 if column == 3 else CM), planned


def _circle(flights: Flights, name: str, title: str, cases: tuple[str, ...]) -> Shown:
    panels: list[Panel] = []
    for column, label in ((0, "x (m)"), (1, "y (m)"), (3, "heading (deg)")):
        curves: list[Curve] = []
        for place, case in enumerate(cases):
            time, flown, planned = _flown(flights.log(case), column)
            curves.append(Curve(_label(case), time, flown, style="steps", color=place))
            if place == 0:
                curves.append(Curve("reference", time, planned, style="dashes", color=6))
        panels.append(Panel(label.split(" ")[0], "time (s)", label, curves))
    for column, label in ((0, "error in x (cm)"), (1, "error in y (cm)"), (3, "error in heading (deg)")):
        curves = [
            Curve(_label(case), *_column(flights.log(case), column), style="steps", color=place)
            for place, case in enumerate(cases)
        ]
        panels.append(Panel("", "time (s)", label, curves))
    parts = [
        f"{_label(case)}: {' / '.join(number(100 * v, 2) for v in _first_maxima(flights, case))} cm" for case in cases
    ]
    sentence = f"Position, heading and their errors; largest error in x / y after the start, {'; '.join(parts)}."
    return Shown(Figure(name, title, sentence, panels), cases)


def _label(case: str) -> str:
    return "MPC on the twin" if case == "circle" else CASES[case].label


def _first_maxima(flights: Flights, case: str) -> list[float]:
    return [float(flights.values(case, f"max_abs_error.{axis}")[0]) for axis in "xy"]


def _column(log: Log, column: int) -> tuple[Array, Array]:
    time, error = _time(log)
    return time, error[:, column]


def _hover(flights: Flights) -> Shown:
    log = flights.log("hover")
    panels = [
        Panel(name, "time (s)", f"{name} (cm)", [Curve("flown", *_column(log, column), style="steps", color=0)])
        for column, name in enumerate("xy")
    ]
    time, u = 1e-9 * log.sent.time, log.sent.u
    means = [float(flights.values("hover", f"mean.u_{name}")[0]) for name in "xy"]
    for column, name in enumerate(("u_x", "u_y")):
        offset = np.full(2, means[column])
        marks = [
            Curve("input", time, u[:, column], style="steps", color=0),
            Curve("its mean: the offset", time[[0, -1]], offset, style="dashes", color=1),
        ]
        panels.append(Panel(name, "time (s)", f"{name} (full stick)", marks))
    sentence = f"Position about the hover point and the inputs; a steady push makes their means {means[0]:.3f} and {means[1]:.3f}."
    return Shown(Figure("fig4", "Fig. 4: hover on the twin", sentence, panels), ("hover",))


def _average_errors(flights: Flights) -> Shown:
    cases = ("circle", "circle_pid", "circle_flat")
    panels: list[Panel] = []
    for state in STATES:
        scale = metric(f"mse.{state}")
        dots = [_dots(flights, [case], f"mse.{state}", [""], place, scale.factor) for place, case in enumerate(cases)]
        panels.append(Panel(state, f"mean squared error, {scale.unit}", "", dots, x_log=True))
    n = len(flights.rows["circle"])
    sentence = f"The circle, {n} shared seeds: mean over the flights with its 95 % interval, logarithmic."
    return Shown(Figure("fig6", "Fig. 6: average squared error per state", sentence, panels), cases)


def _dots(
    flights: Flights,
    cases: Sequence[str],
    name: str,
    names: Sequence[str],
    color: int,
    factor: float,
    of: Callable[[Array], Array] = np.asarray,
) -> Dots:
    """Means over seeds with intervals; one row a case. A single seed has no interval to show."""
    found = [mean_interval(of(flights.values(case, name))) for case in cases]
    value, low, high = (factor * np.array(column) for column in list(zip(*found, strict=True))[:3])
    label = CASES[cases[0]].label
    return Dots(label, names, value, low, high, texts=[number(v) for v in value], color=color)


def _what_it_takes(flights: Flights) -> Shown:
    cases = (
        *("circle", "circle_free", "circle_riccati", "circle_both"),
        *("circle_flat", "circle_flat_unrolled", "circle_flat_zn", "circle_pid"),
    )
    names = [CASES[case].label for case in cases]
    panels = [
        Panel(axis, "rms error, cm", "", [_dots(flights, cases, f"mse.{axis}", names, 0, CM, np.sqrt)], x_log=True)
        for axis in "xy"
    ]
    sentence = (
        "The circle: what makes either controller better or worse in the plane, mean over seeds with its interval."
    )
    return Shown(Figure("what-it-takes", "What it takes in x and y", sentence, panels), cases)


def _heading(flights: Flights) -> Shown:
    cases = ("circle", "circle_exact", "circle_flat", "circle_flat_exact", "fixed", "fixed_pid", "circle_pid")
    names = [CASES[case].label for case in cases]
    rms = Panel(
        "heading", "rms error, deg", "", [_dots(flights, cases, "mse.yaw", names, 0, DEGREES, np.sqrt)], x_log=True
    )
    activity = Panel(
        "u_yaw", "rms change per step, stick", "", [_dots(flights, cases, "step.u_yaw", names, 0, 1.0)], x_log=True
    )
    sentence = (
        "Circles: what the heading error comes from. Exact orientation takes away the cameras' orientation noise."
    )
    return Shown(Figure("heading", "Heading", sentence, [rms, activity]), cases)


def _height(flights: Flights) -> Shown:
    kinds = ("", "_pid", "_free")
    names = [f"{100 * share:g} % low" for share in WEAK]
    dots = [
        _dots(flights, [f"weak{100 * share:.0f}{kind}" for share in WEAK], "mse.z", names, place, CM, np.sqrt)
        for place, kind in enumerate(kinds)
    ]
    words = ("MPC", "PID", "MPC, offset-free in z")
    dots = [mark._replace(label=word) for mark, word in zip(dots, words, strict=True)]
    worst = f"weak{100 * WEAK[-1]:.0f}"
    curves = [
        Curve(word, *_column(flights.log(worst + kind), 2), style="steps", color=place)
        for place, (kind, word) in enumerate(zip(kinds, words, strict=True))
    ]
    panels = [
        Panel("thrust below what is believed", "rms error in z, cm", "", dots, x_log=True),
        Panel(f"{names[-1]}, first seed", "time (s)", "error in z (cm)", curves),
    ]
    sentence = (
        "The paper's one loss to PID: without an integral state in z a thrust that is off is a height that is off."
    )
    return Shown(
        Figure("height", "Height under a thrust mismatch", sentence, panels), tuple(worst + kind for kind in kinds)
    )


def _coupling(flights: Flights) -> Shown:
    pairs = (("circle", "turning"), ("circle_full", "turning_full"))
    names = ("circle", "pirouette circle")
    panels: list[Panel] = []
    for title, name, label, factor, of in (
        ("u_yaw", "rms.u_yaw", "rms, stick", 1.0, np.asarray),
        ("u_yaw", "step.u_yaw", "rms change per step, stick", 1.0, np.asarray),
        ("position", "mse.position", "rms error, cm", CM, np.sqrt),
        ("heading", "mse.yaw", "rms error, deg", DEGREES, np.sqrt),
    ):
        dots = [_dots(flights, cases, name, names, place, factor, of) for place, cases in enumerate(pairs)]
        words = ("coupling removed", "full coupling")
        panels.append(Panel(title, label, "", [d._replace(label=w) for d, w in zip(dots, words, strict=True)]))
    sentence = (
        "The linear model with and without the coupling of x and y through the yaw, mean over seeds with its interval."
    )
    return Shown(Figure("coupling", "Full and removed coupling", sentence, panels), (*pairs[0], *pairs[1]))


def _others(flights: Flights) -> Shown:
    panels: list[Panel] = []
    trajectories = (("pirouette", "pirouette"), ("wheel", "ferris wheel"), ("turning", "pirouette circle"))
    for column, label in (("position", "position error (cm)"), (3, "heading error (deg)")):
        for name, title in trajectories:
            curves: list[Curve] = []
            for place, (tail, word) in enumerate((("", "MPC"), ("_pid", "PID, feedback only"))):
                time, error = _time(flights.log(name + tail))
                y = np.linalg.norm(error[:, :3], axis=1) if isinstance(column, str) else error[:, column]
                curves.append(Curve(word, time, y, style="steps", color=place))
            panels.append(Panel(title if isinstance(column, str) else "", "time (s)", label, curves))
    sentence = "First seed; by feedback only the PID has no share of the planned inputs and lags behind every turn."
    figure = Figure("others", "The other trajectories, MPC and PID", sentence, panels)
    return Shown(figure, tuple(name + tail for name, _ in trajectories for tail in ("", "_pid")))


def times_figure(timing: Timings) -> Figure:
    """Distribution of the measured times of one flight: different every time."""
    curves: list[Curve] = []
    for place, (label, ns) in enumerate(
        (("QP solve", timing.solve_ns), ("whole control step", timing.control_step_ns))
    ):
        shares = np.linspace(0.0, 100.0, 401)
        curves.append(Curve(label, np.percentile(1e-6 * ns[ns > 0], shares), shares, style="steps", color=place))
    curves.append(Curve("the paper's solve", np.array([5.0, 5.0]), np.array([0.0, 100.0]), style="dashes", color=7))
    curves.append(Curve("the paper's solve", np.array([7.0, 7.0]), np.array([0.0, 100.0]), style="dashes", color=7))
    panel = Panel("", "ms", "% of steps below", curves, x_log=True)
    return Figure(
        "solve-times",
        "Computing times",
        "Of one flight flown alone on this host; the figure differs every time.",
        [panel],
    )
