"""The feedback gains that horizon, weights and terminal weight of each controller amount to."""

from collections.abc import Iterator

import numpy as np

from controllers.laws import ControlLaw
from controllers.reference import ReferencePreview
from controllers.signals import Array, Estimate, nanoseconds
from controllers.trajectories.hover import Hover
from heli_twin.paper.cases import CASES
from heli_twin.reporting.figure import Table

NUDGE = 1e-3
"""m, rad, m/s and rad/s: small enough that no limit binds."""
COMPARED = (
    *("circle", "circle_riccati", "circle_even", "circle_free"),
    *("circle_flat", "circle_flat_soft", "circle_flat_zn"),
)


def feedback_gains(law: ControlLaw) -> Array:
    """The response of a controller in hover to errors of x y z yaw (rows) in position and in velocity (columns).

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


def gains_of(case: str) -> Array:
    """The gains (4, 2) of the controller that flies a case."""
    return feedback_gains(CASES[case].experiment(0, 1.0).controller)


def gains_table() -> Table:
    """The table of the present response of each compared controller to an error."""
    rows = [[CASES[case].label, *_cells(gains_of(case))] for case in COMPARED]
    sentence = (
        "Stick per metre or radian of error, and per m/s or rad/s, asked of each controller in hover: "
        "horizon, weights and terminal weight of an MPC come down to these. Integrals come on top."
    )
    return Table("Gains of the controllers", sentence, ["", "x", "y", "z", "yaw"], rows)


def _cells(gains: Array) -> Iterator[str]:
    for p, d in gains:
        yield f"{p:.2f}, {d:.2f}"
