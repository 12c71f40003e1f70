"""Figures over all seeds: means with their intervals, and which figures there are."""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from controllers.signals import Array
from heli_twin.paper.cases import CASES, THRUST_DEFICITS, weak
from heli_twin.paper.claims import CM, FITTED_GUST, SIMULATED, fitted_delay
from heli_twin.paper.comparison import DEGREES
from heli_twin.paper.curves import TIME_LABEL, Shown, circle_figure, error_of, hover_figure, others_figure
from heli_twin.paper.flights import Flights
from heli_twin.reporting.figure import Curve, Dots, Figure, Panel
from heli_twin.reporting.intervals import mean_interval
from heli_twin.reporting.words import metric, number


def figures(flights: Flights) -> Iterator[Shown]:
    """All figures but that of measured times."""
    simulation = (SIMULATED, "simulated_undelayed", "circle")
    circles = circle_figure(flights, "fig3", "Fig. 3: a circle in simulation, and on the twin", simulation)
    yield _with_note(circles, f"The delay is fitted: {fitted_delay(flights)}")
    yield _with_note(hover_figure(flights), FITTED_GUST)
    yield circle_figure(flights, "fig5", "Fig. 5: a circle on the twin", ("circle",))
    yield _average_errors(flights)
    yield _what_it_takes(flights)
    yield _heading(flights)
    yield _height(flights)
    yield _coupling(flights)
    yield others_figure(flights)


def _with_note(shown: Shown, note: str) -> Shown:
    """Add a sentence below the title of a figure."""
    return shown._replace(figure=shown.figure._replace(sentence=f"{shown.figure.sentence} {note}"))


def _dots(
    flights: Flights,
    cases: Sequence[str],
    name: str,
    factor: float = 1.0,
    of: Callable[[Array], Array] = np.asarray,
) -> Dots:
    """Mean of a metric over the seeds with its interval, a row a case; a single seed has no interval to show."""
    found = [mean_interval(of(flights.values(case, name))) for case in cases]
    value, low, high = (factor * np.array(column) for column in list(zip(*found, strict=True))[:3])
    names = [CASES[case].label for case in cases]
    return Dots("", names, value, low, high, texts=[number(v) for v in value])


def _beside(labels: Sequence[str], names: Sequence[str], dots: Sequence[Dots]) -> list[Dots]:
    """Several marks in the same rows, each with its own colour."""
    return [
        mark._replace(label=label, names=names, color=place)
        for place, (label, mark) in enumerate(zip(labels, dots, strict=True))
    ]


def _average_errors(flights: Flights) -> Shown:
    cases = ("circle", "circle_pid", "circle_error", "circle_flat")
    labels = [CASES[case].label for case in cases]
    panels: list[Panel] = []
    for state in ("x", "y", "z", "yaw"):
        scale = metric(f"mse.{state}")
        dots = _beside(labels, [""], [_dots(flights, [case], f"mse.{state}", scale.factor) for case in cases])
        panels.append(Panel(state, f"mean squared error, {scale.unit}", "", dots, x_log=True))
    seeds = len(flights.rows["circle"])
    sentence = f"The circle, nose along the path: mean over {seeds} shared seeds with its 95 % interval."
    return Shown(Figure("fig6", "Fig. 6: average squared error per state", sentence, panels), cases)


def _what_it_takes(flights: Flights) -> Shown:
    cases = (
        *("circle", "circle_unrolled", "circle_free", "circle_riccati", "circle_both", "circle_detailed"),
        *("circle_flat", "circle_flat_soft", "circle_flat_unrolled", "circle_flat_zn", "circle_error", "circle_pid"),
    )
    dots = _dots(flights, cases, "mse.position", CM, np.sqrt)
    panels = [Panel("", "rms position error, cm", "", [dots], x_log=True)]
    sentence = (
        "The circle: what makes either controller better or worse in the plane; mean over seeds with its interval."
    )
    return Shown(Figure("what-it-takes", "What it takes on the circle", sentence, panels), cases)


def _heading(flights: Flights) -> Shown:
    cases = ("circle", "circle_exact", "circle_flat", "circle_flat_exact", "fixed", "fixed_pid", "circle_pid")
    panels = [
        Panel(title, label, "", [_dots(flights, cases, name, factor, of)], x_log=True)
        for title, label, name, factor, of in (
            ("heading", "rms error, deg", "mse.yaw", DEGREES, np.sqrt),
            ("u_yaw", "rms step, % of stick", "step.u_yaw", 100.0, np.asarray),
        )
    ]
    sentence = (
        "Heading errors, and changes of u_yaw per control step; with exact orientation the cameras' noise in it is off."
    )
    return Shown(Figure("heading", "Heading", sentence, panels), cases)


def _height(flights: Flights) -> Shown:
    kinds, labels = ("", "_pid", "_free"), ("MPC", "PID", "MPC, offset-free in z")
    names = [f"{100 * share:g} % low" for share in THRUST_DEFICITS]
    dots = [_dots(flights, [weak(share, kind) for share in THRUST_DEFICITS], "mse.z", CM, np.sqrt) for kind in kinds]
    shown = tuple(weak(THRUST_DEFICITS[-1], kind) for kind in kinds)
    curves: list[Curve] = []
    for place, (case, label) in enumerate(zip(shown, labels, strict=True)):
        time, error = error_of(flights.log(case))
        curves.append(Curve(label, time, error[:, 2], style="steps", color=place))
    panels = [
        Panel("thrust gain", "rms error in z, cm", "", _beside(labels, names, dots), x_log=True),
        Panel(f"{names[-1]}, first seed", TIME_LABEL, "error in z (cm)", curves),
    ]
    sentence = "Without an integral in z, a thrust that is weaker than believed becomes a height that is too low."
    return Shown(Figure("height", "Height under a thrust mismatch", sentence, panels), shown)


def _coupling(flights: Flights) -> Shown:
    pairs, labels = (("circle", "turning"), ("circle_full", "turning_full")), ("coupling removed", "full coupling")
    panels: list[Panel] = []
    for title, name, label, factor, of in (
        ("u_yaw", "rms.u_yaw", "rms, % of stick", 100.0, np.asarray),
        ("u_yaw", "step.u_yaw", "rms change a step, % of stick", 100.0, np.asarray),
        ("position", "mse.position", "rms error, cm", CM, np.sqrt),
        ("heading", "mse.yaw", "rms error, deg", DEGREES, np.sqrt),
    ):
        dots = [_dots(flights, cases, name, factor, of) for cases in pairs]
        panels.append(Panel(title, label, "", _beside(labels, ("circle", "pirouette circle"), dots)))
    sentence = "The linear model with and without the coupling of x and y through the yaw; mean over seeds, interval."
    return Shown(Figure("coupling", "Full and removed coupling", sentence, panels), (*pairs[0], *pairs[1]))
