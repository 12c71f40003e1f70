"""Three PIDs, named for what they are: what the MPC's advantage becomes against each."""

import numpy as np

from controllers.signals import Array
from heli_twin.paper.claims import CM
from heli_twin.paper.comparison import DEGREES, in_plane
from heli_twin.paper.flights import Flights
from heli_twin.reporting.figure import Table
from heli_twin.reporting.intervals import mean_interval
from heli_twin.reporting.words import interval, number

BASELINES = {
    "circle_pid": "feedback only, derivative of the measured velocity: it brakes a moving reference",
    "circle_error": "feedback only, derivative of the error: planned velocities, no planned inputs",
    "circle_flat": "derivative of the error, with the planned inputs",
}
"""The same gains in each."""
RIVALS = {"circle": "MPC, the paper's weights", "circle_riccati": "MPC, Riccati"}


def baselines_table(flights: Flights) -> Table:
    """The errors of each PID on the circle, over those of both MPC."""
    rows = [
        [
            text,
            f"{number(CM * in_plane(flights, case))} cm, {number(DEGREES * flights.rms(case, 'yaw'))} deg",
            *(interval(mean_interval(_plane(flights, case) / _plane(flights, rival))) for rival in RIVALS),
        ]
        for case, text in BASELINES.items()
    ]
    sentence = (
        "The paper does not say which derivative its PID had, nor whether it was told the planned inputs. All three"
        " have the same gains and fly the circle with the same seeds: rms errors in the plane and in heading, and how"
        " many times the error of an MPC in the plane that is, mean over the seeds with its interval."
    )
    return Table("Three PIDs", sentence, ["PID", "rms errors", *(f"times {name}" for name in RIVALS.values())], rows)


def _plane(flights: Flights, case: str) -> Array:
    """(n,) root mean square error in the plane of each flight, m."""
    return np.sqrt(flights.values(case, "mse.x") + flights.values(case, "mse.y"))
