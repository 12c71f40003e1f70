"""The swashplate's servos: deadband, limited speed, and backlash in the linkage."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.signals import Array
from heli_twin.lab.plant.effects import Physics, Updates


@dataclass(frozen=True, slots=True)
class Servo:
    """Deadband, slew limit and backlash between the receiver and the lag of the two cyclic inputs.

        deadband   the servo moves only if it is more than `deadband` away from its input
        slew       it moves by at most `slew` a second: the mean speed over every period of the effects
        backlash   the swashplate follows it with play: it stands still while the servo is within `backlash` / 2

    Source: slew: CoaX servos, 2.4 rad/s (Fassler, coax-control), at about 1 rad of travel; deadband and backlash:
    engineering estimates for linear servos of this size.
    """

    kind: Literal["servo"] = "servo"
    deadband: Annotated[float, Ge(0), Le(0.5), Unit("full stick"), doc("input change that it ignores")] = 0.005
    slew: Annotated[float, Gt(0), Le(1e4), Unit("full stick / s"), doc("greatest speed; 10000: no limit")] = 2.5
    backlash: Annotated[float, Ge(0), Le(0.5), Unit("full stick"), doc("play of the linkage, end to end")] = 0.03

    def build(self, model: Any) -> None:
        """Add nothing to the model."""

    def start(self, physics: Physics) -> Updates:
        """Begin in the middle of the play, at the trim."""
        servos = ServosInFlight(self, physics.trim[:2])
        return Updates(every_period=servos.begin_period, on_input=servos.move)


class ServosInFlight:
    """Both cyclic servos of one flight."""

    def __init__(self, spec: Servo, trim: Array) -> None:
        self._spec = spec
        self._servo = self._swashplate = trim.tolist()
        self._began = self._servo

    def begin_period(self, physics: Physics) -> None:
        """Note where the servos stand: from here they get as far as their speed allows."""
        self._began = self._servo

    def move(self, physics: Physics) -> None:
        """Move servos and swashplate towards the input."""
        spec, travel = self._spec, self._spec.slew * physics.period
        play = 0.5 * spec.backlash
        servos: list[float] = []
        swashplate: list[float] = []
        for u, servo, began, plate in zip(
            physics.u[:2].tolist(), self._servo, self._began, self._swashplate, strict=True
        ):
            u = min(max(u, -1.0), 1.0)
            goal = u if abs(u - servo) > spec.deadband else servo
            servo = min(max(goal, began - travel), began + travel)
            servos.append(servo)
            swashplate.append(min(max(plate, servo - play), servo + play))
        self._servo, self._swashplate = servos, swashplate
        physics.u[:2] = swashplate
