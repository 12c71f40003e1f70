"""Causes of the comparison's results: each suspected cause is removed, and the effect is measured again."""

from collections.abc import Callable

import numpy as np

from heli_twin.paper.claims import CM, largest
from heli_twin.paper.comparison import DEGREES
from heli_twin.paper.flights import THRUST_DEFICITS, Flights, weak
from heli_twin.paper.verdicts import explains
from heli_twin.reporting.figure import Table
from heli_twin.reporting.words import number


def causes(flights: Flights) -> Table:
    """A table of effects, suspected causes, the effects without them, and whether a cause explains its effect."""
    rows: list[list[str]] = []
    plane = partial_gap(flights, _plane, CM, "cm")
    effect = "MPC errs more in the plane than PID with the same reference inputs, rms"
    lags = "PID by feedback only errs more in the plane than MPC, rms"
    rows += [
        plane(lags, "it is not told the planned inputs", ("circle_pid", "circle"), ("circle_flat", "circle")),
        plane(
            effect,
            "roll-forward carries the PID's gains",
            ("circle", "circle_flat"),
            ("circle", "circle_flat_unrolled"),
        ),
        plane(effect, "gains of the PID above Z-N", ("circle", "circle_flat"), ("circle", "circle_flat_zn")),
        plane(effect, "terminal weight Q_f = Q", ("circle", "circle_flat"), ("circle_riccati", "circle_flat")),
        plane(effect, "a push the MPC does not predict", ("circle", "circle_flat"), ("circle_free", "circle_flat")),
    ]
    yaw = partial_gap(flights, lambda f, case: f.rms(case, "yaw"), DEGREES, "deg")
    noisy = "MPC errs more in heading than PID with feed-forward, rms"
    exact = ("circle_exact", "circle_flat_exact")
    rows.append(yaw(noisy, "noise of the cameras' orientation", ("circle", "circle_flat"), exact))
    lagging = "PID by feedback only errs more in heading than MPC, rms"
    rows.append(yaw(lagging, "a heading that turns", ("circle_pid", "circle"), ("fixed_pid", "fixed")))
    height = partial_gap(flights, lambda f, case: f.rms(case, "z"), CM, "cm")
    for share in THRUST_DEFICITS:
        low = f"MPC errs more in height than PID, thrust {100 * share:g} % low, rms"
        rows.append(
            height(
                low, "no integral in z", (weak(share), weak(share, "_pid")), (weak(share, "_free"), weak(share, "_pid"))
            )
        )
    rows.append(_simulated(flights))
    sentence = (
        "Each suspected cause is taken away and the difference flown again with the same seeds: it explains the effect "
        "if at least half of the difference goes with it."
    )
    return Table("Why", sentence, ["effect", "suspected cause", "with it", "without it", "explains it"], rows)


Gap = Callable[[str, str, tuple[str, str], tuple[str, str]], list[str]]


def partial_gap(flights: Flights, size: Callable[[Flights, str], float], factor: float, unit: str) -> Gap:
    """Makes rows that compare the difference of two cases with the difference of two others."""

    def row(effect: str, cause: str, there: tuple[str, str], gone: tuple[str, str]) -> list[str]:
        a, b, c, d = (factor * size(flights, case) for case in (*there, *gone))
        cells = [f"{number(one)} against {number(other)} {unit}" for one, other in ((a, b), (c, d))]
        return [effect, cause, *cells, explains(a - b, c - d)]

    return row


def _plane(flights: Flights, case: str) -> float:
    return float(np.hypot(flights.rms(case, "x"), flights.rms(case, "y")))


def _simulated(flights: Flights) -> list[str]:
    with_it, without = (
        CM * max(largest(flights, case, axis).value for axis in "xy") for case in ("simulated", "simulated_undelayed")
    )
    cells = [f"{number(with_it)} cm", f"{number(without)} cm", explains(with_it, without)]
    return ["The simulated circle is off by centimetres, largest", "poses 40 ms old, taken for new", *cells]
