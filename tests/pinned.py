"""Flights that stay what they are: some numbers of each, in `flights/pinned.json`.

`python tests/pinned.py` writes the file again, after a change of physics that was meant and has a new version.
"""

import json
from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from controllers.signals import Array
from heli_twin import fly, load
from heli_twin.experiment.families import members

PINS = Path(__file__).with_name("flights") / "pinned.json"
QUADROTOR = Path(__file__).with_name("lab") / "plant/airframes/quadrotor.xml"
FAMILIES = {
    "faults": (members("heli_twin.lab.faults"), ["start=0.4", "duration=0.6"]),
    "disturbances": (members("heli_twin.lab.disturbances"), []),
    "plant.effects": (members("heli_twin.lab.plant.effects"), []),
}


def fault(kind: str, **values: float) -> list[str]:
    """Return the changes that add a fault."""
    return [f"faults.{kind}=on", *(f"faults.{kind}.{field}={value}" for field, value in values.items())]


def changed(kind: str, spec: type) -> list[str]:
    """Return changes of a trajectory's angles, rates and times, for what hides where they are 0 or 1."""
    numbers = {"rate": 0.8, "yaw_rate": 0.7, "direction": 0.4, "yaw": 0.3, "phase": 0.5, "ramp": 1.2, "height": 1.1}
    return [
        f"trajectory.{field.name}={numbers[field.name]}"
        for field in fields(spec)
        if field.name in numbers and (kind, field.name) not in {("doublets", "yaw"), ("csv", "ramp")}
    ]


FLIGHTS: dict[str, list[str]] = {
    "lab": ["lab", "duration=4"],
    "before its newer effects": ["lab_simple", "duration=3", "trajectory=lemniscate"],
    "pid": ["lab", "duration=2", "controller=pid"],
    "pid with feed-forward": ["lab", "duration=2", "controller=pid", "controller.feed_forward=flat"],
    "full coupling": ["lab", "duration=2", "controller.coupling=full", "trajectory=pirouette_circle"],
    "riccati": ["lab", "duration=2", "controller.terminal=riccati", "trajectory=ferris_wheel"],
    "saturated": ["lab", "duration=2", "trajectory=hover", "disturbances.bias=on", "disturbances.bias.x=0.9"],
    "detailed": ["detailed", "duration=3", "trajectory=pirouette"],
    "ideal": ["ideal", "duration=2", "controller=pid"],
    "quadrotor": ["lab", "duration=0.6", f"plant.model={QUADROTOR}", *fault("gyro_failure", start=0.1, duration=0.2)],
    "poses lost on the way up": [
        "lab",
        "duration=8",
        "trajectory=takeoff_and_landing",
        *fault("pose_outage", start=4.0, duration=4.0),
    ],
    "detailed, poses lost": ["detailed", "duration=3", *fault("pose_outage", start=1.0, duration=0.4)],
    "detailed, poses swapped": ["detailed", "duration=2", *fault("pose_swap", start=0.5, duration=1.4, turn=0.5)],
    "battery empty": ["lab", "duration=3", "plant.effects.battery.charge=0.01"],
    "battery empty, pid": ["lab", "duration=4", "plant.effects.battery.charge=0.01", "controller=pid"],
    "shaken": ["lab", "duration=2", "excitation=multisine"],
    **{
        f"trajectory {kind}": ["lab", "duration=1.5", f"trajectory={kind}", *changed(kind, spec)]
        for kind, spec in members("controllers.trajectories").items()
    },
    **{
        f"{family} {kind}": ["lab", "duration=1.5", f"{family}.{kind}=on", *(f"{family}.{kind}.{c}" for c in changes)]
        for family, (kinds, changes) in FAMILIES.items()
        for kind in kinds
    },
}
"""Preset and changes of each flight."""


def numbers(name: str) -> dict[str, Any]:
    """Fly one of them and return what is pinned of it."""
    preset, *changes = FLIGHTS[name]
    log = fly(load(preset, changes), log_dir=None).log
    seen = np.linspace(0, len(log.truth.time) - 1, 4).astype(int)[1:]
    truth, sent = log.truth, log.sent.u
    return {
        "outcome": log.outcome,
        "events": dict(Counter(event.name for event in log.events)),
        "truth": rounded(np.column_stack([truth.position, truth.quat_wxyz, truth.velocity])[seen]),
        "sent": rounded(sent[np.minimum(seen, len(sent) - 1)]),
        "believed": rounded(log.estimate.disturbance[-1]),
    }


def rounded(values: Array) -> list[Any]:
    """Return numbers without digits that no host agrees on."""
    return np.round(values, 8).tolist()


if __name__ == "__main__":
    PINS.write_text(
        "{\n" + ",\n".join(f"{json.dumps(name)}: {json.dumps(numbers(name))}" for name in FLIGHTS) + "\n}\n",
        encoding="utf-8",
    )
