"""One MuJoCo world for several helicopters: what flies into another bounces off it, and falls.

Each is the twin of `heli_twin.lab.plant.mujoco`, with its parts named after it. Helicopters touch each other with their
rotors (one solid disc from the lower rotor to the bar), canopy, skids and fin; blades neither break nor catch.
"""

from collections.abc import Mapping
from copy import copy
from functools import lru_cache
from itertools import chain
from typing import Any

import numpy as np

from controllers.signals import Array
from heli_twin.lab.plant import STILL_AIR
from heli_twin.lab.plant.motion import Gimbal
from heli_twin.lab.plant.mujoco import MuJoCo, edited, engine, mjcf_of, model_file
from heli_twin.lab.plant.size import ABOVE_M, LOWER_ROTOR_M, RADIUS_M
from heli_twin.lab.plant.twin import Parts, Twin

EACH_OTHER = 2
"""Bit of the shapes that touch those of other helicopters; bit 1 is of those that touch the floor."""
PARKED_M = 1000.0
OFF = [0.0] * 4
"""Input (4,) of motors that are switched off."""


class World:
    """Several helicopters in one world; `twins` has each by its name. All fly on together.

    Args:
        plants: What each is, with the same physics step.
        starts: The physical state (8,) of each at time 0.

    Raises:
        ValueError: One would stand in the floor.
    """

    def __init__(self, plants: Mapping[str, MuJoCo], starts: Mapping[str, Array]) -> None:
        # A copy: faults and effects change the model in flight.
        self._model = model = copy(_compiled(tuple(plants.items())))
        self._data = data = engine().MjData(model)
        self._mj_step = engine().mj_step
        self._step_ns = next(iter(plants.values())).step_ns
        self._steps = 0
        self.twins: dict[str, Twin] = {}
        for name, plant in plants.items():
            motion = Gimbal(model, data, model.joint(f"{name}/x").id)
            trim = np.array(plant.trim)
            parts = Parts(engine(), model, data, motion, trim, plant.mass, mjcf_of(plant), f"{name}/")
            self.twins[name] = Twin(parts, plant, starts[name])
        of_body = [model.body(i).name.partition("/")[0] for i in range(model.nbody)]
        self._ship_of_geom = [of_body[body] if body else "" for body in model.geom_bodyid]
        self.touched: dict[tuple[str, str], int] = {}
        """When each two that have touched did so first, ns, in the order of these times."""

    def advance(self, until: int) -> None:
        """Fly on with all to `until`, ns, a whole number of physics steps."""
        target = until // self._step_ns
        while self._steps < target:
            steps = min(twin.due(target) for twin in self.twins.values())
            for _ in range(steps):
                for twin in self.twins.values():
                    twin.turn_moment()
                self._mj_step(self._model, self._data, 1)
                self._steps += 1
                if self._data.ncon:
                    self._note_who_touch()
            for twin in self.twins.values():
                twin.passed(steps)

    def _note_who_touch(self) -> None:
        for pair in self._data.contact.geom.tolist():
            a, b = sorted(self._ship_of_geom[geom] for geom in pair)
            if a and a != b:
                self.touched.setdefault((a, b), self._steps * self._step_ns)

    def switch_off(self, name: str) -> None:
        """Let a helicopter whose flight is over fall, without motors; take one that has diverged out of the room."""
        twin = self.twins[name]
        if not all(map(np.isfinite, chain(*twin.truth()[1:5]))):
            self._park(name)
        twin.hold(OFF, STILL_AIR)

    def _park(self, name: str) -> None:
        """Put a helicopter far away, at rest and without weight: numbers that are none would spread to others."""
        model, data = self._model, self._data
        for i in range(model.njnt):
            if model.joint(i).name.startswith(f"{name}/"):
                data.qpos[model.jnt_qposadr[i]] = data.qvel[model.jnt_dofadr[i]] = 0.0
                data.qacc_warmstart[model.jnt_dofadr[i]] = 0.0
        for i in range(model.nbody):
            if model.body(i).name.startswith(f"{name}/"):
                model.body_gravcomp[i] = 1.0
        parked = np.zeros(8)
        parked[[0, 2]] = PARKED_M + list(self.twins).index(name), PARKED_M
        self.twins[name].place(parked)


@lru_cache(maxsize=16)
def _compiled(plants: tuple[tuple[str, MuJoCo], ...]) -> Any:
    """Compile one model of all; the one floor has the gap of the floor that has the greatest."""
    room = engine().MjSpec.from_file(str(model_file()))
    for part in (*room.keys, *room.actuators, room.body("yaw_frame"), room.body("air")):
        room.delete(part)
    room.compiler.discardvisual = True
    room.option.timestep = 1e-9 * plants[0][1].step_ns
    floor = room.geom("floor")
    for name, plant in plants:
        own = edited(plant, visuals=False)
        floor.gap = max(floor.gap, own.geom("floor").gap)
        for part in (*own.keys, own.geom("floor")):
            own.delete(part)
        _let_touch(own.body("fuselage"))
        room.attach(own, prefix=f"{name}/", frame=room.worldbody.add_frame())
    return room.compile()


def _let_touch(fuselage: Any) -> None:
    """Let the shapes that touch the floor touch other helicopters too, and all of the rotors instead of a thin disc."""
    kind, least, most = None, LOWER_ROTOR_M, ABOVE_M
    for geom in fuselage.geoms:
        if geom.name == "disc_upper":
            kind = geom.type
        elif geom.contype:
            geom.contype |= EACH_OTHER
            geom.conaffinity |= EACH_OTHER
    fuselage.add_geom(
        name="rotors",
        type=kind,
        size=(RADIUS_M, 0.5 * (most - least), 0.0),
        pos=(0.0, 0.0, 0.5 * (most + least)),
        contype=EACH_OTHER,
        conaffinity=EACH_OTHER,
    )
