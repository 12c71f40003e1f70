"""Rules of study designs: as many flights as they say, on the axes of the study, the same again."""

from collections.abc import Iterator
from functools import cache
from itertools import islice
from typing import Any

from heli_twin.conformance.rules import require
from heli_twin.experiment import Experiment
from heli_twin.experiment.tree import canonical_json, experiment_of
from heli_twin.studies.axes import axis_of
from heli_twin.studies.columns import COMPLETED
from heli_twin.studies.designs import Point, Row
from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import Alternative, Space, varied

_AXES: tuple[dict[str, Any], ...] = (
    {},
    {"plant.mass": [0.026, 0.028, 0.030], "controller.horizon": [10, 18]},
    {"plant.mass": {"linspace": [0.026, 0.030, 3]}, "radio.latency": {"linspace": [0.0, 0.02, 2]}},
    {"plant.mass": {"uniform": [0.026, 0.030]}, "mocap.latency": {"uniform": [0.0, 0.02]}},
)
_MOST_RUNS = 20_000
"""Of a design that asks for more, only so many are looked at."""
_FIRST = 20
"""Points that are compared; those of a search are slow."""


@cache
def _spaces() -> tuple[Space, ...]:
    base = canonical_json(Experiment())
    alternatives = Alternative("mpc", {}), Alternative("pid", {"controller": "pid"})
    return tuple(
        Space(
            base,
            alternatives if "controller.horizon" not in written else alternatives[:1],
            {path: axis_of(path, values) for path, values in written.items()},
            range(3, 5),
            "rmse.position",
            2.5,
        )
        for written in _AXES
    )


def _fitting(design: Any) -> Iterator[Space]:
    """The spaces that a design accepts."""
    for space in _spaces():
        try:
            design.check(space)
        except StudyError:
            continue
        yield space


def _points(design: Any, space: Space) -> Iterator[tuple[Point, int]]:
    """The points of a design and how many runs each is; an adaptive one is told that every flight completed."""
    batches, rows = design.batches(space), None
    while True:
        try:
            batch = [*(next(batches) if rows is None else batches.send(rows))]
        except StopIteration:
            return
        rows = []
        for point in batch:
            require(isinstance(point, Point), f"batches() yields a {type(point).__name__} in place of a Point")
            flown = [*_rows(point, space)]
            rows += flown if design.adaptive else []
            yield point, len(flown)


def _rows(point: Point, space: Space) -> Iterator[Row]:
    for alternative in space.alternatives:
        if point.alternatives is None or alternative.name in point.alternatives:
            for seed in point.seeds or space.seeds:
                metrics = {"rmse.position": 0.05, "sustained.yaw": 0.01, "sustained.position": 0.05}
                place = {"alternative": alternative.name, "seed": seed, "outcome": COMPLETED}
                yield {**metrics, **place, **point.changes, **point.labels}


def says_which_axes_it_can_use(design: Any) -> None:
    """It accepts lists, ranges, distributions or no axes, and refuses others with a StudyError of one sentence."""
    for space in _spaces():
        try:
            design.check(space)
        except StudyError as error:
            require(0 < len(str(error)) < 500 and "\n" not in str(error), f"check() says {str(error)[:100]!r}")
    require(isinstance(design.adaptive, bool), f"adaptive is {design.adaptive!r}, not True or False")


def flies_no_more_than_it_counts(design: Any) -> None:
    """It asks for one run at least, and for no more than count() says."""
    for space in _fitting(design):
        most, runs = design.count(space), 0
        for _, count in _points(design, space):
            runs += count
            require(runs <= most, f"it asks for {runs} runs or more, and count() says {most}")
            if runs > _MOST_RUNS:
                break
        require(runs, "it asks for no run")


def asks_for_what_can_be_flown(design: Any) -> None:
    """Each point changes fields of the experiment to values that they accept."""
    for space in _fitting(design):
        for point, _ in islice(_points(design, space), 10):
            experiment_of(varied(space.base, point.changes))


def asks_for_the_same_points_again(design: Any) -> None:
    """The same study asks for the same points in the same order: that is how it is resumed."""
    for space in _fitting(design):
        first, second = ([*islice(_points(design, space), _FIRST)] for _ in range(2))
        require(first == second, "the same study asked for other points: draw from the study's seeds")
