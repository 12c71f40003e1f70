"""A payload, fixed under the skids or on a string, picked up and dropped in flight."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from heli_twin.lab.plant.effects import Physics, Updates

HOOK_M = -0.0435
"""Height of the hook between the skids, seen from the centre of gravity."""
PARKED_M = (0.0, 0.0, 1000.0)
"""The place of a payload on a string until it is picked up."""


@dataclass(frozen=True, slots=True)
class Payload:
    """A point mass at the hook, or below it on a string that only pulls; a string of 0 fixes it.

        |payload - hook| <= string                     the string's force acts at both ends, along it
        mass and inertia of the fuselage + payload     where it is fixed

    It is picked up where it hangs at rest under the helicopter, or lies under it if the string is longer than that.
    A dropped payload on a string falls to the floor; what was fixed is gone.

    Source: a point mass on a massless inextensible cable, Bisgaard, la Cour-Harbo and Bendtsen, "Modeling of generic
    slung load system", AIAA 2006-6816.
    """

    kind: Literal["payload"] = "payload"
    mass: Annotated[float, Gt(0), Le(0.02), Unit("kg"), doc("of the payload")] = 0.002
    string: Annotated[float, Ge(0), Le(2), Unit("m"), doc("length of the string; 0: fixed")] = 0.3
    pick_up: Annotated[float, Ge(0), Le(36_000), Unit("s"), doc("when it is picked up")] = 0.0
    drop: Annotated[float, Ge(0), Le(36_000), Unit("s"), doc("when it is dropped")] = 36_000.0

    def build(self, model: Any) -> None:
        """Add the payload's body and the string."""
        if not self.string:
            return
        body = model.worldbody.add_body(name="payload")
        body.mass, body.inertia, body.explicitinertial = self.mass, (1e-9, 1e-9, 1e-9), True
        for axis in ("x", "y", "z"):
            slide = model.joint(f"air_{axis}")
            body.add_joint(name=f"payload_{axis}", type=slide.type, axis=slide.axis)
        body.add_geom(name="payload", type=model.geom("canopy").type, size=(0.004, 0.004, 0.004))
        body.add_site(name="payload")
        model.body("fuselage").add_site(name="hook", pos=(0.0, 0.0, HOOK_M))
        string = model.add_tendon(name="string", range=(0.0, self.string), limited=True, solref_limit=(0.004, 1.0))
        string.wrap_site("hook")
        string.wrap_site("payload")

    def start(self, physics: Physics) -> Updates:
        """Begin with the payload if it is picked up at the start."""
        if self.pick_up == 0.0 < self.drop:
            physics.trim[2] += self.mass * -physics.model.opt.gravity[2] / physics.model.actuator("u_z").gainprm[0]
        carried = OnString(self, physics) if self.string else Fixed(self, physics)
        return Updates(every_period=carried.update)


class Fixed:
    """A payload that is a part of the fuselage while it is carried."""

    def __init__(self, spec: Payload, physics: Physics) -> None:
        model = physics.model
        self._body = model.body("fuselage").id
        self._periods = -1
        self._first, self._last = _periods(spec, physics)
        empty = model.body_mass[self._body], model.body_ipos[self._body].copy(), model.body_inertia[self._body].copy()
        mass = empty[0] + spec.mass
        hook = np.array([0.0, 0.0, HOOK_M])
        # Parallel axes: both masses about the common centre of gravity; the offsets are along or nearly along z.
        reduced = empty[0] * spec.mass / mass
        apart = hook - empty[1]
        inertia = empty[2] + reduced * (apart @ apart - apart**2)
        self._empty = empty
        self._loaded = mass, (empty[0] * empty[1] + spec.mass * hook) / mass, inertia

    def update(self, physics: Physics) -> None:
        """Load or unload the fuselage."""
        self._periods += 1
        state = self._loaded if self._first <= self._periods < self._last else self._empty
        model = physics.model
        model.body_mass[self._body], model.body_ipos[self._body], model.body_inertia[self._body] = state


class OnString:
    """A payload with a body of its own."""

    def __init__(self, spec: Payload, physics: Physics) -> None:
        model = physics.model
        self._length = spec.string
        self._string = model.tendon("string").id
        self._place = slice(model.joint("payload_x").qposadr[0], model.joint("payload_x").qposadr[0] + 3)
        self._speed = slice(model.joint("payload_x").dofadr[0], model.joint("payload_x").dofadr[0] + 3)
        self._periods = -1
        self._first, self._last = _periods(spec, physics)
        physics.loose_geom = model.geom("payload").id

    def update(self, physics: Physics) -> None:
        """Park the payload, hang it on, or let it fall."""
        self._periods += 1
        data = physics.data
        if self._periods < self._first:
            data.qpos[self._place], data.qvel[self._speed] = PARKED_M, 0.0
        elif self._periods == self._first:
            x, y, z = physics.position.tolist()
            data.qpos[self._place] = x, y, max(z + HOOK_M - self._length, 0.004)
            data.qvel[self._speed] = physics.velocity
        physics.model.tendon_limited[self._string] = self._first <= self._periods < self._last


def _periods(spec: Payload, physics: Physics) -> tuple[int, int]:
    """First and last (not included) update with the payload."""
    return round(spec.pick_up / physics.period), round(spec.drop / physics.period)
