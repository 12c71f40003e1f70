"""Several helicopters in one room, as a value: each has an experiment of its own, and they share a coordination."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

from annotated_types import MaxLen, doc

from controllers.coordinations import Coordination
from controllers.coordinations.none import NoCoordination
from controllers.markers import OneOf, by_name, checked_name
from heli_twin.experiment import Experiment
from heli_twin.experiment.fields import APART
from heli_twin.experiment.help_text import explained
from heli_twin.experiment.objects import validated_parts
from heli_twin.experiment.scenarios import MOST_SHIPS, Own, Scenario
from heli_twin.experiment.values import ExperimentError
from heli_twin.lab.network import Network
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.lab.radio import Dsm2
from heli_twin.terminal_text import clean, instead


@explained
@dataclass(frozen=True, slots=True)
class Several:
    """One flight of several helicopters. Same value, same flight, byte for byte.

    What a scenario names flies as `every` says, unless `ships` has an experiment of this name; what it wants to fly is
    the scenario's. Further `ships` fly their own trajectories. All start at the same time.
    """

    scenario: Annotated[Scenario, OneOf("heli_twin.experiment.scenarios"), doc("what they want to fly")] = field(
        default_factory=Own
    )
    coordination: Annotated[
        Coordination, OneOf("controllers.coordinations"), doc("how they keep out of each other's way")
    ] = field(default_factory=NoCoordination)
    network: Annotated[Network, doc("between their ground stations")] = field(default_factory=Network)
    transmitters: Annotated[
        Literal["each", "one"],
        doc(
            "`each`: every helicopter has a transmitter of its own, whose frames begin when they like; `one`: a single"
            " one sends a frame to each in turn, so that n helicopters wait n times as long; estimator.command_delay"
            " is then 0.011 s and 0.011 s for each of them"
        ),
    ] = "each"
    world: Annotated[
        Literal["apart", "shared"],
        doc(
            "`apart`: each in a simulated world of its own, and the flight of who touches another is over;"
            " `shared`: all in one MuJoCo world, in which they push each other and fall"
        ),
    ] = "apart"
    shared: Annotated[
        tuple[str, ...],
        MaxLen(100),
        doc(
            'whose random numbers are the same for all: `["gust"]` is one gust in the whole room,'
            ' `["faults.pose_outage"]` cameras that fail for all at once'
        ),
    ] = ()
    every: Annotated[Experiment, doc("each helicopter, but for what `ships` says of one")] = field(
        default_factory=Experiment
    )
    ships: Mapping[str, Experiment] = field(default_factory=dict[str, Experiment], metadata={APART: True})
    """Helicopters with an experiment of their own, by name."""

    def fleet(self) -> dict[str, Experiment]:
        """Return what each helicopter flies, in alphabetical order of their names.

        Raises:
            ExperimentError: The scenario has no room for so many.
        """
        try:
            wishes = self.scenario.wishes()
        except ValueError as error:
            raise ExperimentError(f"scenario: {error}") from None
        of_scenario = {
            name: replace(self.ships.get(name, self.every), trajectory=wish) for name, wish in wishes.items()
        }
        return dict(sorted({**self.ships, **of_scenario}.items()))


def components(experiment: Experiment) -> list[str]:
    """Return the names under which the parts of a helicopter's flight draw their random numbers."""
    air = (name if name == d.kind else f"disturbances.{name}" for name, d in by_name(experiment.disturbances).items())
    return ["mocap", "radio", "compute", *air, *(f"faults.{name}" for name in by_name(experiment.faults))]


_EQUAL: dict[str, tuple[Callable[[Experiment], Any], str]] = {
    "duration": (lambda e: e.duration, "s"),
    "plant.step": (lambda e: e.plant.step, "s"),
    "controller.period": (lambda e: e.controller.period, "s"),
    "estimator.lead": (lambda e: e.estimator.lead, "s"),
    "volume.half_width": (lambda e: e.volume.half_width, "m"),
    "volume.height": (lambda e: e.volume.height, "m"),
    "seed": (lambda e: e.seed, ""),
    "noise": (lambda e: [list(pair) for pair in e.noise], ""),
}
"""What is one for the whole room."""
_SAID_BY = {"estimator.lead": "estimator.command_delay"}
"""The field that says a value, where it has another name."""


def checked_several(several: Any) -> Several:
    """Return several helicopters after a check of each field and of what must be the same for all.

    Raises:
        ExperimentError: One sentence that names the field, its value and the limit.
    """
    if type(several) is not Several:
        raise ExperimentError(f"this is of the class {type(several).__name__}: give a Several")
    ships: Any = several.ships
    if not isinstance(ships, Mapping):
        raise ExperimentError("ships is no table of experiments by name: give ships={'a': Experiment(), ...}")
    for name, ship in several.ships.items():
        if type(ship) is not Experiment:
            raise ExperimentError(f"ships.{clean(name, 60)} is of the class {type(ship).__name__}: give an Experiment")
        try:
            checked_name(name)
        except ValueError as error:
            raise ExperimentError(f"ships: {error}") from None
    ships = {name: validated_parts(ship, f"ships.{name}.") for name, ship in sorted(several.ships.items())}
    checked: Several = replace(validated_parts(several, ""), ships=ships)
    fleet = checked.fleet()
    if not 1 <= len(fleet) <= MOST_SHIPS:
        raise ExperimentError(
            f"there are {len(fleet)} helicopters: give 1 to {MOST_SHIPS}, by scenario=swap scenario.ships=4, or by"
            " ships.a.trajectory=hover and others"
        )
    _check_equal(fleet)
    if checked.world == "shared":
        _check_shared(fleet)
    if checked.transmitters == "one":
        _check_turns(fleet)
    known = components(next(iter(fleet.values())))
    unknown = next((name for name in checked.shared if name not in known), None)
    if unknown is not None:
        raise ExperimentError(f"shared: unknown component {instead(unknown, known)}")
    return checked


def _kind(part: object) -> str:
    return clean(str(getattr(part, "kind", type(part).__name__)), 60)


def _check_shared(fleet: Mapping[str, Experiment]) -> None:
    for name, other in fleet.items():
        if type(other.plant) is not MuJoCo:
            raise ExperimentError(
                f"ships.{name}.plant = {_kind(other.plant)}: one shared world has the plant mujoco alone:"
                " write plant=mujoco or world=apart"
            )


LONGEST_ROUND_S = 1.0
"""Longest time between two frames to a helicopter."""


def _check_turns(fleet: Mapping[str, Experiment]) -> None:
    (first, one), *_ = fleet.items()
    for name, e in fleet.items():
        if not isinstance(e.radio, Dsm2) or not isinstance(one.radio, Dsm2):
            raise ExperimentError(
                f"ships.{name}.radio = {_kind(e.radio)}: one transmitter for all has frames: write radio=dsm2"
                " or transmitters=each"
            )
        if e.radio.frame_period != one.radio.frame_period:
            raise ExperimentError(
                f"ships.{name}.radio.frame_period = {e.radio.frame_period} s, but {one.radio.frame_period} s for"
                f" {first}: one transmitter for all has one; write radio.frame_period=... or transmitters=each"
            )
        if e.radio.frame_period * len(fleet) > LONGEST_ROUND_S:
            raise ExperimentError(
                f"radio.frame_period = {e.radio.frame_period} s: {len(fleet)} helicopters in turn wait"
                f" {e.radio.frame_period * len(fleet):.3g} s, at most {LONGEST_ROUND_S:g} s are allowed: write"
                " transmitters=each or fewer helicopters"
            )


def _check_equal(fleet: Mapping[str, Experiment]) -> None:
    (first, one), *others = fleet.items()
    for path, (value, unit) in _EQUAL.items():
        for name, other in others:
            if value(other) != value(one):
                raise ExperimentError(
                    f"ships.{name}.{path} = {value(other)} {unit}".rstrip()
                    + f", but {value(one)} {unit}".rstrip()
                    + f" for {first}: it has to be the same for all in one room; write {_SAID_BY.get(path, path)}=..."
                    " for all of them"
                )
