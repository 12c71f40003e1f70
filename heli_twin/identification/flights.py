"""The flights that `heli-twin identify` flies when it is given no logs: doublets on every axis."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from controllers.trajectories.doublets import Doublets
from heli_twin.experiment import Experiment
from heli_twin.flown_logs import fly_into
from heli_twin.identification.fit import IdentificationError

PLANE_FLIGHTS, HEIGHT_AND_YAW_FLIGHTS = 6, 2
DURATION_S = {"plane": 60.0, "height_and_yaw": 40.0}
"""Duration of each flight. Gusts of 0.25 m/s push as hard as the drag of a slow flight: after six minutes of doublets
the standard deviation of k_x and k_y is 2 %, and it falls with the root of the time. Height and yaw need a tenth of
that."""


def experiments(base: Experiment) -> list[Experiment]:
    """The flights of an identification.

    Args:
        base: The lab to fly in. Everything but the trajectory, the duration and the seed is taken from it, also the
            controller, whose model need not be right; if it flies doublets, their sizes are kept.
    """
    doublets = base.trajectory if isinstance(base.trajectory, Doublets) else Doublets()
    flights = [replace(doublets, axes="plane")] * PLANE_FLIGHTS + [
        replace(doublets, axes="height_and_yaw")
    ] * HEIGHT_AND_YAW_FLIGHTS
    return [
        replace(base, trajectory=flight, duration=DURATION_S[flight.axes], seed=base.seed + i)
        for i, flight in enumerate(flights)
    ]


def fly_them(flights: list[Experiment], folder: Path, progress: Callable[[], None] = lambda: None) -> list[Path]:
    """Fly several experiments at a time, and keep their logs.

    Args:
        flights: What to fly.
        folder: Where the logs go.
        progress: Called after every flight.

    Returns:
        The logs, in the order of the flights.

    Raises:
        IdentificationError: A flight ended early.
    """
    logs: list[Path] = []
    for path, outcome in fly_into(folder, flights):
        if outcome.kind != "completed":
            raise IdentificationError(
                f"a flight of doublets failed, it {outcome.text} (see {path}): make them smaller, such as"
                " trajectory=doublets trajectory.x=0.5 trajectory.y=0.5, or choose a controller that flies this"
                " helicopter"
            )
        logs.append(path)
        progress()
    return logs
