"""Causes of the comparison's results: each suspected cause is taken away, or given to the rival too."""

from collections.abc import Callable
from typing import NamedTuple

from heli_twin.paper.cases import THRUST_DEFICITS, weak
from heli_twin.paper.claims import CM, SIMULATED, largest
from heli_twin.paper.comparison import DEGREES, in_plane
from heli_twin.paper.flights import Flights
from heli_twin.paper.verdicts import explains
from heli_twin.reporting.figure import Table
from heli_twin.reporting.words import number

Pair = tuple[str, str]
"""Two cases that are compared."""
NOT_FLOWN = "-"


class Suspect(NamedTuple):
    """A suspected cause of the difference between two controllers."""

    effect: str
    cause: str
    there: Pair
    """The two cases; the first errs more."""
    gone: Pair | None = None
    """The same without the cause."""
    shared: Pair | None = None
    """The same with the cause given to the rival."""


PLANE = (
    "PID by feedback only errs more in the plane than MPC, rms",
    "MPC errs more in the plane than PID with the same reference inputs, rms",
)
MPC_AND_PID = ("circle", "circle_flat")
IN_PLANE = (
    Suspect(PLANE[0], "its derivative brakes the motion", ("circle_pid", "circle"), ("circle_error", "circle")),
    Suspect(
        PLANE[0], "it is not told planned velocities and inputs", ("circle_pid", "circle"), ("circle_flat", "circle")
    ),
    Suspect(
        PLANE[1],
        "low gains of the MPC",
        MPC_AND_PID,
        ("circle_even", "circle_flat"),
        ("circle", "circle_flat_soft"),
    ),
    Suspect(PLANE[1], "gains of the PID above Z-N", MPC_AND_PID, shared=("circle", "circle_flat_zn")),
    Suspect(
        PLANE[1],
        "roll-forward serves the PID more",
        MPC_AND_PID,
        gone=("circle_unrolled", "circle_flat_unrolled"),
        shared=("circle", "circle_flat_unrolled"),
    ),
    Suspect(PLANE[1], "a push the MPC does not predict", MPC_AND_PID, ("circle_free", "circle_flat")),
)
TURNS = "PID by feedback only errs more in heading than MPC, rms"
IN_HEADING = (
    Suspect(
        "MPC errs more in heading than PID with feed-forward, rms",
        "noise of the cameras' orientation, answered with a higher gain",
        MPC_AND_PID,
        ("circle_exact", "circle_flat_exact"),
        ("circle", "circle_flat_soft"),
    ),
    Suspect(TURNS, "a heading that turns", ("circle_pid", "circle"), ("fixed_pid", "fixed")),
    Suspect(TURNS, "its derivative brakes the turn", ("circle_pid", "circle"), ("circle_error", "circle")),
)
IN_HEIGHT = tuple(
    Suspect(
        f"MPC errs more in height than PID, thrust {100 * share:g} % low, rms",
        "no integral in z",
        (weak(share), weak(share, "_pid")),
        (weak(share, "_free"), weak(share, "_pid")),
        (weak(share), weak(share, "_pid_blind")),
    )
    for share in THRUST_DEFICITS
)


def causes(flights: Flights) -> Table:
    """A table of effects and suspected causes, and what is left of the effect without them."""
    rows = [
        *(row(suspect, lambda case: CM * in_plane(flights, case), "cm") for suspect in IN_PLANE),
        *(row(suspect, lambda case: DEGREES * flights.rms(case, "yaw"), "deg") for suspect in IN_HEADING),
        *(row(suspect, lambda case: CM * flights.rms(case, "z"), "cm") for suspect in IN_HEIGHT),
        _simulated(flights),
    ]
    sentence = (
        "Each suspected cause is taken away, or given to the rival too, and the difference flown again with the same"
        " seeds. A cause explains the difference if each time the two come together: at most half of it is left, with"
        " either sign. Where it turns round, the one that erred more errs less by more than that, so that something"
        " else is at work too."
    )
    header = ["effect", "suspected cause", "with it", "taken away", "given to the rival too", "explains it"]
    return Table("Why", sentence, header, rows)


def row(suspect: Suspect, size: Callable[[str], float], unit: str) -> list[str]:
    """A row of the table: the errors of both cases, each time, and the answer."""

    def pair(cases: Pair | None) -> tuple[str, list[float]]:
        if cases is None:
            return NOT_FLOWN, []
        one, other = (size(case) for case in cases)
        return f"{number(one)} against {number(other)} {unit}", [one - other]

    (there, (effect,)), (gone, left), (shared, also) = map(pair, (suspect.there, suspect.gone, suspect.shared))
    return [suspect.effect, suspect.cause, there, gone, shared, explains(effect, *left, *also)]


def _simulated(flights: Flights) -> list[str]:
    with_it, without = (
        CM * max(largest(flights, case, axis).value for axis in "xy") for case in (SIMULATED, "simulated_undelayed")
    )
    cells = [f"{number(with_it)} cm", f"{number(without)} cm", NOT_FLOWN, explains(with_it, without)]
    return ["The simulated circle is off by centimetres, largest", "poses 40 ms old, taken for new", *cells]
