"""The entities of a flight in Rerun and their columns: the same live and replayed."""

from collections.abc import Iterable, Iterator
from itertools import chain

import numpy as np
import rerun as rr

from controllers.rotations import wrap_angle
from controllers.signals import Array
from heli_twin.recording.log import Log, Times
from heli_twin.viewing.blueprint import Scales
from heli_twin.viewing.style import CONTACT_COLOURS, INPUTS, PHASE_COLOURS, POSITIONS

TRAIL_STEP_S = 0.02
"""Length in time of one piece of the flown trail: one control period."""
WIND_ARROW_SCALE = 0.1
"""Length of the wind's arrow, m per m/s."""
ROTOR_RATE_REV_S = 1.7
"""Speed of the drawn rotors: slow enough to see their direction."""

Rows = tuple[str, Times, Iterable[rr.ComponentColumn]]
"""Entity, times (n,) and columns of n rows."""


def rows(log: Log, scales: Scales) -> Iterator[Rows]:
    """Everything that is shown of a log or a slice of one."""
    return chain(_scene(log), _plots(log, scales), _computing(log, scales))


def entities(log: Log, scales: Scales) -> frozenset[str]:
    """The entities of a log that have data."""
    return frozenset(entity for entity, times, _ in rows(log, scales) if len(times))


def tracking(log: Log) -> tuple[Times, Array]:
    """Truth minus reference: times (n,) and x y z (world, m), yaw (rad, in [-pi, pi)) as (n, 4)."""
    truth, reference = log.truth, log.reference
    both, now, wanted = np.intersect1d(truth.time, reference.time, return_indices=True)
    error = np.column_stack([truth.position, truth.yaw])[now] - reference.x[wanted, :4]
    error[:, 3] = wrap_angle(error[:, 3])
    return both, error


def _scene(log: Log) -> Iterator[Rows]:
    truth, reference, plan = log.truth, log.reference, log.plan
    xyzw = [1, 2, 3, 0]
    yield (
        "world/helicopter",
        truth.time,
        rr.Transform3D.columns(translation=truth.position, quaternion=truth.quat_wxyz[:, xyzw]),
    )
    half_turn = np.pi * ROTOR_RATE_REV_S * 1e-9 * truth.time
    for name, half_angle in ("rotor_lower", half_turn), ("rotor_upper", -half_turn):
        zero = np.zeros_like(half_angle)
        spin = np.stack([zero, zero, np.sin(half_angle), np.cos(half_angle)], axis=1)
        yield f"world/helicopter/{name}", truth.time, rr.Transform3D.columns(quaternion=spin)
    half_step = 0.5 * TRAIL_STEP_S * truth.velocity
    pieces = np.stack([truth.position - half_step, truth.position + half_step], axis=1)
    yield "world/trail", truth.time, rr.LineStrips3D.columns(strips=pieces.astype(np.float32))
    floor = truth.position * [1.0, 1.0, 0.0]
    plumb_line = np.stack([truth.position, floor], axis=1).astype(np.float32)
    yield "world/plumb_line", truth.time, rr.LineStrips3D.columns(strips=plumb_line)
    both, here, blowing = np.intersect1d(truth.time, log.disturbance.time, return_indices=True)
    wind = rr.Arrows3D.columns(origins=truth.position[here], vectors=WIND_ARROW_SCALE * log.disturbance.wind[blowing])
    yield "world/wind", both, wind
    for t, points in log.reference_paths:
        yield "world/reference_path", np.array([t]), rr.LineStrips3D.columns(strips=points[None].astype(np.float32))
    yield "world/reference", reference.time, rr.Points3D.columns(positions=reference.x[:, :3])
    yield "world/horizon", plan.time, rr.LineStrips3D.columns(strips=plan.x[:, :, :3])
    yield "world/mocap", log.pose.time, rr.Points3D.columns(positions=log.pose.position)


def _plots(log: Log, scales: Scales) -> Iterator[Rows]:
    truth, reference, estimate, pose = log.truth, log.reference, log.estimate, log.pose
    true_x = np.column_stack([truth.position, truth.yaw])
    both, error = tracking(log)
    yield "error/position", both, scalars(100 * error[:, :3])
    yield "error/yaw", both, scalars(np.degrees(error[:, 3]))
    unit = np.array([1, 1, 1, 180 / np.pi])
    for i, name in enumerate(POSITIONS):
        yield f"position/{name}/{scales.source}", truth.time, scalars(unit[i] * true_x[:, i])
        yield f"position/{name}/reference", reference.time, scalars(unit[i] * reference.x[:, i])
        yield f"position/{name}/estimate", estimate.stamp, scalars(unit[i] * estimate.x[:, i])
        if name != "yaw":
            yield f"position/{name}/mocap", pose.stamp, scalars(pose.position[:, i])
    for i, state in enumerate(scales.states[: log.estimate_extra.x.shape[1]]):
        yield f"states/{state.name}/estimate", log.estimate_extra.stamp, scalars(log.estimate_extra.x[:, i])
    yield "input/all", log.sent.time, scalars(log.sent.u)
    for i, name in enumerate(INPUTS):
        yield f"input/{name}/sent", log.sent.time, scalars(log.sent.u[:, i])
        yield f"input/{name}/acting", log.acting.time, scalars(log.acting.u[:, i])
        limits = np.tile([scales.u_min[i], scales.u_max[i]], (len(log.sent.time), 1))
        yield f"input/{name}/limits", log.sent.time, scalars(limits)


def _computing(log: Log, scales: Scales) -> Iterator[Rows]:
    timing, air = log.timing, log.disturbance
    deadline = np.full(len(timing.time), 1e9 * scales.period)
    yield (
        "computing",
        timing.time,
        scalars(1e-6 * np.stack([timing.control_step_ns, timing.solve_ns, deadline], axis=1)),
    )
    yield "air/wind", air.time, scalars(air.wind)
    yield "air/push", air.time, scalars(air.acceleration)
    yield "air/moment", log.disturbance_moment.time, scalars(log.disturbance_moment.moment)
    yield "air/thrust", air.time, scalars(air.thrust_factor)
    yield "state/controller", log.qp.time, rr.StateChange.columns(state=log.qp.status.tolist())
    phases = [event for event in log.events if event.name in PHASE_COLOURS]
    changed = np.array([event.time for event in phases], np.int64)
    yield "state/supervisor", changed, rr.StateChange.columns(state=[event.name for event in phases])
    in_the_air, on_the_floor = CONTACT_COLOURS
    if scales.source == "truth":
        contact = np.where(log.truth.touching, on_the_floor, in_the_air).tolist()
        yield "state/contact", log.truth.time, rr.StateChange.columns(state=contact)
    times = np.array([event.time for event in log.events], np.int64)
    text = [f"{event.name}: {event.text}" for event in log.events]
    level = [RERUN_LEVELS[event.severity] for event in log.events]
    yield "events", times, rr.TextLog.columns(text=text, level=level)


RERUN_LEVELS = {
    "unknown": "TRACE",
    "debug": "DEBUG",
    "info": "INFO",
    "warning": "WARN",
    "error": "ERROR",
    "fatal": "CRITICAL",
}
"""Our severities as Rerun calls them."""


def scalars(values: Array) -> rr.ComponentColumnList:
    """Columns of one number, or k numbers, for each moment: values (n,) or (n, k)."""
    columns = rr.Scalars.columns(scalars=values.ravel())
    return columns if values.ndim == 1 else columns.partition([values.shape[1]] * len(values))
