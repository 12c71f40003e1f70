"""The flights that `heli-twin identify` flies when it is given no logs: doublets, and what to do if one fails."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from controllers.trajectories.doublets import Doublets
from heli_twin.experiment import Experiment
from heli_twin.identification.fit import IdentificationError
from heli_twin.workers.fleet import fleet

PLANE, HEIGHT_AND_YAW = 6, 2
"""How many flights of each kind."""
SECONDS = {"plane": 60.0, "height_and_yaw": 40.0}
"""How long each lasts. Gusts of 0.25 m/s push as hard as the drag of a slow flight: six minutes of doublets bring k_x
and k_y within 2 % (one standard deviation), which falls with the root of the time. Height and yaw need a tenth."""


def experiments(base: Experiment) -> list[Experiment]:
    """The flights of an identification.

    Everything but the trajectory, the duration and the seed is as in `base`: the controller too, which may believe
    what it likes as long as it flies. Where `base` flies doublets, theirs are flown.
    """
    doublets = base.trajectory if isinstance(base.trajectory, Doublets) else Doublets()
    flights = [replace(doublets, axes="plane")] * PLANE + [replace(doublets, axes="height_and_yaw")] * HEIGHT_AND_YAW
    return [
        replace(base, trajectory=flight, duration=SECONDS[flight.axes], seed=base.seed + i)
        for i, flight in enumerate(flights)
    ]


def fly_them(flights: list[Experiment], folder: Path, progress: Callable[[], None] = lambda: None) -> list[Path]:
    """Fly, several at a time.

    Args:
        flights: What to fly.
        folder: Where their logs go.
        progress: Told of every flight that is over.

    Returns:
        The logs, in the order of the flights.

    Raises:
        IdentificationError: A flight ended early.
    """
    logs: list[Path] = []
    with fleet() as run:
        for path in run(partial(_flown, folder), flights):
            logs.append(path)
            progress()
    return logs


def _flown(folder: Path, experiment: Experiment) -> Path:
    from heli_twin.mission import fly

    result = fly(experiment, log_dir=folder)
    assert result.path is not None
    if result.outcome.kind != "completed":
        raise IdentificationError(
            f"a flight of doublets failed, it {result.outcome.text} (see {result.path}): make them smaller, such as"
            " trajectory=doublets trajectory.x=0.5 trajectory.y=0.5, or choose a controller that flies this helicopter"
        )
    return result.path
