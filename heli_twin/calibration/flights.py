"""The calibration flights: two that tell the parameters, and one to check the twin on."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from controllers.excitations.multisine import Multisine
from controllers.trajectories.doublets import Doublets
from heli_twin.calibration.checks import CalibrationError
from heli_twin.experiment import Experiment
from heli_twin.experiment.text import load
from heli_twin.flown_logs import fly_into

FITTED = ("calibrate_plane", "calibrate_height_yaw")
"""Presets of the flights that the fit uses."""
CHECK = "calibrate_check"
"""Preset of the flight to check the twin on."""


class Planned(NamedTuple):
    """A calibration flight in a lab."""

    name: str
    experiment: Experiment


def planned(base: Experiment) -> list[Planned]:
    """Return the three flights in the lab of an experiment.

    Args:
        base: Everything but trajectory, excitation, duration and seed is taken from it.
    """
    flights: list[Planned] = []
    for name in (*FITTED, CHECK):
        there = load(name)
        here = replace(
            base,
            trajectory=there.trajectory,
            excitation=there.excitation,
            duration=there.duration,
            seed=base.seed + there.seed,
        )
        flights.append(Planned(name, here))
    return flights


def fly_them(flights: list[Planned], folder: Path, progress: Callable[[], None] = lambda: None) -> list[Path]:
    """Fly the flights, some at a time, and return their logs in `folder`.

    Raises:
        CalibrationError: A flight ended early.
    """
    logs: list[Path] = []
    for flight, (path, outcome) in zip(flights, fly_into(folder, [f.experiment for f in flights]), strict=True):
        if outcome.kind != "completed":
            raise CalibrationError(
                f"the flight {flight.name} failed, it {outcome.text} (see {path}): fly with smaller motions, such as"
                f" `heli-twin fly {flight.name} trajectory.x=0.5 trajectory.y=0.5 excitation.pitch=0.08`, and give its"
                " log to `heli-twin calibrate`"
            )
        logs.append(path)
        progress()
    return logs


def card(flight: Planned) -> str:
    """Return a flight as text for the people in a lab: what to set up, what to fly, when to stop."""
    e = flight.experiment
    t = np.arange(0.0, e.duration, 0.02)
    flat = e.trajectory.flat(t)
    low, high = flat.z.min(axis=0), flat.z.max(axis=0)
    lines = [
        f"FLIGHT CARD {flight.name}",
        f"  length       {e.duration:g} s, with a full battery",
        f"  where        x {low[0]:.2f} to {high[0]:.2f} m, y {low[1]:.2f} to {high[1]:.2f} m,"
        f" z {low[2]:.2f} to {high[2]:.2f} m, and 0.4 m to each side for gusts and the excitation",
        f"  what         {_what(e)}",
    ]
    if isinstance(e.excitation, Multisine):
        s = e.excitation
        lines += [
            f"  excitation   added to the sent commands: multisine, {s.slowest:g} to {s.fastest:g} Hz, repeats every"
            f" {s.record:g} s, no frequency on two inputs",
            f"               root mean square: pitch {s.pitch:g}, roll {s.roll:g}, thrust {s.thrust:g}, yaw {s.yaw:g}"
            " of full stick",
        ]
    lines += [
        "  record       every pose with the time of its picture, every sent command with its time, on one clock",
        "  before       weigh the helicopter with its battery; note the wind: doors shut, air conditioning off",
        "  stop         tilt beyond 30 degrees, 0.3 m to a wall, 0.3 m above the floor, cameras lost for 0.3 s",
        f"  then         heli-twin import RECORDING, heli-twin calibrate {flight.name}.mcap ... --mass KG",
    ]
    return "\n".join(lines)


def _what(e: Experiment) -> str:
    if isinstance(e.trajectory, Doublets):
        axes = zip(("x", "y", "z", "heading"), e.trajectory.peaks, ("m", "m", "m", "rad"), strict=True)
        moved = ", ".join(f"{axis} {peak:g} {unit}/s^2" for axis, peak, unit in axes if peak)
        return f"doublets of {moved}, all at once, in closed loop"
    return f"{e.trajectory.kind}, in closed loop"  # pyright: ignore[reportAttributeAccessIssue]
