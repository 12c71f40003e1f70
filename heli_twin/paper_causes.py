"""Why the comparison comes out as it does: each suspected cause is taken away, and the effect measured again."""

from collections.abc import Callable, Iterator

import numpy as np

from controllers.laws import ControlLaw
from controllers.reference import ReferencePreview
from controllers.signals import Array, Estimate
from controllers.trajectories.hover import Hover
from heli_twin.chance import nanoseconds
from heli_twin.paper_claims import CM, largest
from heli_twin.paper_comparison import DEGREES
from heli_twin.paper_flights import CASES, WEAK, Flights, weak
from heli_twin.paper_verdicts import explains
from heli_twin.studies.report.figure import Table
from heli_twin.studies.report.words import number

NUDGE = 1e-3
"""m, rad, m/s and rad/s: small enough that no limit binds."""
COMPARED = ("circle", "circle_riccati", "circle_free", "circle_flat", "circle_flat_zn")


def causes(flights: Flights) -> Table:
    """Effects, suspected causes, what taking them away did, and whether that explains the effect."""
    rows: list[list[str]] = []
    plane = partial_gap(flights, _plane, CM, "cm")
    effect = "MPC errs more in the plane than PID with the same reference inputs, rms"
    rows += [
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
    turned = "PID by feedback only errs more in heading than MPC, rms"
    rows.append(yaw(turned, "a heading that turns", ("circle_pid", "circle"), ("fixed_pid", "fixed")))
    height = partial_gap(flights, lambda f, case: f.rms(case, "z"), CM, "cm")
    for share in WEAK:
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


def feedback_gains(law: ControlLaw) -> Array:
    """How a controller in hover answers errors of x y z yaw (rows) in position and in velocity (columns).

    Returns:
        (4, 2) change of the axis' own input for each unit of error, stick per m, rad, m/s or rad/s.
    """
    hover = ReferencePreview(Hover(), law.model, nanoseconds(law.period), 0)(0, law.steps)

    def answer(offset: Array) -> Array:
        unknown = np.zeros((4, 3))
        return law.start().step(0, Estimate(0, hover.x[0] + offset, np.zeros(4), unknown, 0, 0), hover).u

    rest = answer(np.zeros(8))
    gains = [(rest - answer(NUDGE * nudge)) / NUDGE for nudge in np.eye(8)]
    return np.array([[gains[axis][axis], gains[axis + 4][axis]] for axis in range(4)])


def gains_table() -> Table:
    """What each controller of the comparison makes of an error at this moment."""
    rows = [[CASES[case].label, *_gains(CASES[case].experiment(0, 1.0).controller)] for case in COMPARED]
    sentence = (
        "Stick per metre or radian of error, and per m/s or rad/s, asked of each controller in hover: "
        "horizon, weights and terminal weight of an MPC come down to these. Integrals come on top."
    )
    return Table("Gains of the controllers", sentence, ["", "x", "y", "z", "yaw"], rows)


def _gains(law: ControlLaw) -> Iterator[str]:
    for p, d in feedback_gains(law):
        yield f"{p:.2f}, {d:.2f}"
