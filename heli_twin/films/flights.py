"""What a film shows of a flight at each moment, and where the camera stands."""

from collections.abc import Sequence
from math import cos, radians, sin, tan
from typing import Any, Literal, NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.experiment.tree import ExperimentError
from heli_twin.lab.plant.renderer import FIELD_OF_VIEW_DEG, Ball, Camera, Line, Pose
from heli_twin.logbook import viewed_experiment
from heli_twin.metrics.motion import Motion, Span, errors, motion, outages
from heli_twin.recording import Log
from heli_twin.reporting.figure import color

CameraKind = Literal["follow", "room", "top"]
TRAIL_S = 3.0
MOST_PATH_POINTS, MOST_TRAIL_POINTS = 200, 50
PLUMB_COLOR = "#8a9099"
ROTOR_RATE_REV_S = 1.7
"""Speed of the drawn rotors: slow enough to see them turn."""
FOLLOW_M, FOLLOW_SMOOTHING_S, NEAREST_M = 0.9, 0.6, 0.8
AZIMUTH_DEG, ELEVATION_DEG = -30.0, -26.0
REFERENCE_COLOR, PLAN_COLOR = "#1a1a1a", "#8c2699"
"""Black, and a purple that no flight has."""
BODY_M = 0.12
"""Half the size of the helicopter."""


class Shown(NamedTuple):
    """A flight as a film shows it."""

    log: Log
    name: str
    color: str
    plant: Any
    moved: Motion
    quat_wxyz: Array
    """(n, 4) beside `moved`."""
    path: Array
    """(k, 3) reference path, world, m."""
    error: tuple[Array, Array]
    """Times (m,), s, and errors (m, 4)."""
    lost: Sequence[Span]

    def distance(self, start: float, end: float) -> tuple[Array, Array]:
        """Times (k,), s, from start to end, and the distance from the reference then, m."""
        time, error = self.error
        kept = (time >= start) & (time <= end)
        return time[kept], np.linalg.norm(error[kept, :3], axis=1)

    @property
    def end(self) -> float:
        """End of the flight, s."""
        return float(self.moved.time[-1])


def shown(log: Log, name: str, number: int) -> Shown:
    """Prepare a flight; the n-th has the n-th colour.

    Raises:
        HeliTwinError: The log has no positions.
    """
    moved = motion(log)
    if not len(moved.time):
        raise HeliTwinError(f"{name or 'the log'} has neither truth nor poses: there is nothing to film")
    quat = log.truth.quat_wxyz
    if moved.by_cameras:
        _, first = np.unique(log.pose.stamp, return_index=True)
        quat = log.pose.quat_wxyz[first]
    try:
        plant = viewed_experiment(log).plant
    except ExperimentError:
        plant = None
    path = log.reference_paths[0][1] if log.reference_paths else log.reference.x[:, :3]
    step = max(1, len(path) // MOST_PATH_POINTS)
    return Shown(log, name, color(number), plant, moved, quat, path[::step], errors(log), outages(log))


def pose(flight: Shown, t: float) -> Pose:
    """Where the helicopter is at a time, s; after the end where it was last."""
    time = flight.moved.time
    position = np.array([np.interp(t, time, flight.moved.state[:, i]) for i in range(3)])
    after = int(np.clip(np.searchsorted(time, t), 1, max(len(time) - 1, 1)))
    before = after - 1
    after = min(after, len(time) - 1)
    span = time[after] - time[before]
    share = float(np.clip((t - time[before]) / span, 0.0, 1.0)) if span > 0 else 0.0
    a, b = flight.quat_wxyz[before], flight.quat_wxyz[after]
    # q and -q are one attitude: take the short way.
    mixed = (1 - share) * a + share * np.copysign(1.0, a @ b) * b
    return Pose(position, mixed if np.linalg.norm(mixed) > 0 else a, 2 * np.pi * ROTOR_RATE_REV_S * min(t, flight.end))


def drawing(flight: Shown, t: float, here: Array) -> tuple[list[Line], list[Ball]]:
    """Plumb line, reference path, trail and plan as lines, and the reference as a ball."""
    # Down to the floor, so that the eye has the height.
    lines, balls = [Line(np.array([here, [here[0], here[1], 0.0]]), rgba(PLUMB_COLOR), 1.0)], []
    if len(flight.path) > 1:
        lines.append(Line(flight.path, rgba(REFERENCE_COLOR), 1.5))
    time, state = flight.moved.time, flight.moved.state
    first, last = np.searchsorted(time, [t - TRAIL_S, t])
    trail = state[first:last, :3]
    step = max(1, len(trail) // MOST_TRAIL_POINTS)
    lines.append(Line(np.vstack([trail[::step], here]), rgba(flight.color), 3.0))
    plan = flight.log.plan
    latest = int(np.searchsorted(plan.time, 1e9 * t + 1, side="right")) - 1
    if latest >= 0 and t <= flight.end:
        lines.append(Line(plan.x[latest, :, :3].astype(float), rgba(PLAN_COLOR), 3.0))
    reference = flight.log.reference
    if len(reference.time):
        at = [np.interp(t, 1e-9 * reference.stamp, reference.x[:, i]) for i in range(3)]
        balls.append(Ball(np.array(at), rgba(REFERENCE_COLOR)))
    return lines, balls


def rgba(name: str) -> tuple[float, float, float, float]:
    """Return a colour such as #1a1a1a as four numbers from 0 to 1."""
    r, g, b = (int(name[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return (r, g, b, 1.0)


class Cameras(NamedTuple):
    """Where the camera of each flight stands at each frame."""

    kind: CameraKind
    still: Camera
    targets: Sequence[Array]
    """For each flight (frames, 3): what a following camera looks at."""

    def at(self, flight: int, frame: int) -> Camera:
        """The camera of a flight at a frame."""
        if self.kind != "follow":
            return self.still
        return Camera(self.targets[flight][frame], FOLLOW_M, AZIMUTH_DEG, ELEVATION_DEG)


def cameras(flights: Sequence[Shown], kind: CameraKind, times: Array, aspect: float) -> Cameras:
    """Place the camera: still, so that it sees all that is flown in the film, or following smoothly.

    Args:
        flights: All flights of the film; they share a still camera.
        kind: `follow`, `room` or `top`.
        times: (frames,) s.
        aspect: Width of one flight's picture by its height.
    """
    points = [_within(flight, times) for flight in flights]
    targets = [_smooth(flight, times) for flight in flights] if kind == "follow" else []
    return Cameras(kind, _still(np.concatenate(points), kind, aspect), targets)


def _within(flight: Shown, times: Array) -> Array:
    time = flight.moved.time
    kept = (time >= times[0]) & (time <= times[-1])
    flown = flight.moved.state[kept, :3] if kept.any() else flight.moved.state[-1:, :3]
    return np.vstack([flown, flight.path])


def _smooth(flight: Shown, times: Array) -> Array:
    """Mean positions (frames, 3) about each time."""
    offsets = np.linspace(-FOLLOW_SMOOTHING_S, FOLLOW_SMOOTHING_S, 13)
    around = times[:, None] + offsets
    time, state = flight.moved.time, flight.moved.state
    return np.stack([np.interp(around, time, state[:, i]).mean(axis=1) for i in range(3)], axis=1)


def _still(points: Array, kind: CameraKind, aspect: float) -> Camera:
    """A camera that has points (n, 3) in its picture, and a helicopter at each."""
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    azimuth, elevation = (0.0, -89.9) if kind == "top" else (AZIMUTH_DEG, ELEVATION_DEG)
    a, e = radians(azimuth), radians(elevation)
    ahead = np.array([cos(e) * cos(a), cos(e) * sin(a), sin(e)])
    left = np.array([-sin(a), cos(a), 0.0])
    across = points - centre
    aside, above = np.abs(across @ left) + BODY_M, np.abs(across @ np.cross(ahead, left)) + BODY_M
    # Each point has to be in the pyramid that the camera sees.
    half = tan(radians(FIELD_OF_VIEW_DEG / 2))
    needed = np.maximum(aside / (half * aspect), above / half) - across @ ahead
    return Camera(centre, max(float(needed.max()), NEAREST_M), azimuth, elevation)
