"""A mutation run: one token of a module is replaced, and the nearest tests have to notice it.

`python tests/mutants.py controllers 60` mutates 60 places of one room (a third word is the seed) and prints a table.
Each mutant is tested in a fork of a process that has already imported the libraries, in a copy of the repository.
What the nearest tests let pass meets all tests of its part.
"""

import ast
import io
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tokenize
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
ROOMS = (
    "controllers",
    "heli_twin/lab",
    "heli_twin/metrics",
    "heli_twin/reporting/intervals.py",
    "heli_twin/identification",
)
SWAPS = {"+": "-", "-": "+", "*": "/", "/": "*", "**": "*", "<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!="} | {
    "!=": "==", "+=": "-=", "-=": "+=", "and": "or", "or": "and", "True": "False", "False": "True", "is": "is not",
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "cos": "sin", "sin": "cos",
}  # fmt: skip
TEST_FILES = 3
"""The nearest test files of a module, which meet its mutants first."""
OTHER_NAMES = {
    "heli_twin/experiment/families.py": ["own/test_own_members.py", "experiment/test_families.py"],
    "heli_twin/experiment/named_classes.py": ["own/test_own_members.py"],
    "heli_twin/experiment/family_needs.py": ["own/test_own_members.py", "test_conformance.py"],
    "heli_twin/experiment/own.py": ["own/test_own_members.py"],
    "controllers/linear_equation.py": ["controllers/test_linear_equation.py"],
    "controllers/laws/external.py": ["own/test_external_laws.py"],
    "controllers/line_process.py": ["own/test_external_laws.py"],
    "controllers/programs.py": ["own/test_external_laws.py"],
    "controllers/receding.py": ["controllers/test_ltv_mpc.py", "controllers/test_detailed_flight.py"],
    "controllers/planar.py": ["controllers/test_condensed_qp.py"],
    "controllers/detailed_ltv.py": ["controllers/test_detailed_model.py", "controllers/test_detailed_flight.py"],
    "controllers/detailed_flatness.py": ["controllers/test_detailed_model.py", "controllers/test_detailed_flight.py"],
    "controllers/laws/detailed_mpc.py": ["controllers/test_detailed_flight.py", "controllers/test_detailed_model.py"],
    "controllers/detailed_motion.py": ["controllers/test_detailed_kalman.py", "controllers/test_detailed_flight.py"],
    "controllers/estimators/detailed_kalman.py": [
        "controllers/test_detailed_kalman.py",
        "controllers/test_detailed_flight.py",
    ],
    "controllers/pace.py": ["controllers/test_derivatives.py", "controllers/test_trajectories.py"],
    "controllers/descent.py": ["controllers/test_supervisor.py"],
    "controllers/markers.py": ["controllers/test_pid.py", "lab/test_mocap.py"],
    "controllers/pose_screen.py": ["controllers/test_pose_screen.py", "controllers/test_kalman.py"],
    "controllers/rotations.py": [
        "controllers/test_rotations.py",
        "controllers/test_flatness.py",
        "controllers/test_pid.py",
        "controllers/test_offset_free.py",
    ],
    "controllers/splines.py": [
        "controllers/test_splines.py",
        "controllers/test_derivatives.py",
        "controllers/test_trajectories.py",
    ],
    **{
        f"controllers/{name}.py": [f"controllers/{near}.py", "controllers/coordinations/test_sequential.py"]
        for name, near in {
            "right_of_way": "test_right_of_way",
            "scene": "test_scene",
            "separation": "coordinations/test_separation",
            "turns": "test_take_off",
            "take_off": "test_take_off",
            "emergency": "test_emergency",
            "wish_plan": "test_wish_plan",
            "plan_qp": "coordinations/test_plan_qp",
            "committed_plan": "coordinations/test_committed_plan",
        }.items()
    },
    "heli_twin/several/room.py": ["several/test_room.py", "lab/test_downwash.py"],
    "controllers/coordinations/sequential.py": [
        "controllers/coordinations/test_in_danger.py",
        "controllers/coordinations/test_sequential.py",
    ],
    "heli_twin/metrics/several.py": ["metrics/test_several.py", "several/test_room.py"],
    "heli_twin/lab/compute.py": ["lab/test_faults.py", "lab/test_chance.py", "flights/test_flights.py"],
    "heli_twin/lab/plant/contract.py": ["lab/plant/test_airframe.py"],
    "heli_twin/lab/plant/motion.py": ["lab/plant/test_mujoco.py", "lab/plant/test_airframe.py"],
    "heli_twin/lab/plant/twin.py": [
        "lab/plant/test_mujoco.py",
        "lab/plant/test_world.py",
        "lab/plant/effects/test_effects.py",
        "lab/plant/test_airframe.py",
    ],
    "heli_twin/lab/plant/__init__.py": ["lab/plant/test_ideal.py", "lab/plant/effects/test_effects.py"],
}
"""The tests of modules whose name no test file has, in `tests/`, nearest first."""
PICTURES = {"heli_twin/lab/plant/renderer.py"}
"""Modules that draw: their lights and colours are looked at, and decide no flight and no figure."""
FOLDER_TESTS = {
    "controllers/trajectories": ["tests/controllers/test_derivatives.py"],
    "controllers": ["tests/flights/test_pinned.py"],
    "heli_twin/lab": ["tests/flights/test_pinned.py"],
}
"""Further tests of every module below a folder."""
TEST_CPU_LIMIT_S = 60
"""Of one test, in processor time, which a busy machine does not stretch; a mutant that hangs is noticed by it."""
LIBRARIES = """numpy scipy.optimize scipy.linalg scipy.stats scipy.integrate scipy.signal pydantic daqp threadpoolctl
hypothesis.strategies annotated_types mujoco google.protobuf mcap.reader zstandard foxglove_schemas_protobuf"""


EQUIVALENT = {
    (
        "heli_twin/lab/plant/effects/payload.py",
        "body.mass, body.inertia, body.explicitinertial = self.mass, (1e-9, 1e-9, 1e-9), False",
    ): "MuJoCo computes another inertia, so small that it turns nothing",
    (
        "heli_twin/metrics/response.py",
        "stands = np.abs(np.diff(reference)) < REST_RATE * period",
    ): "differs only for a speed equal to the limit in all digits",
    (
        "heli_twin/metrics/margins.py",
        "above = gains[gains >= 1.0]",
    ): "differs only for a loop on its limit of stability in all digits",
    (
        "heli_twin/identification/data.py",
        "steady = (jump[:, :3] <= MAX_JUMP_M).all(axis=1) & (jump[:, 3:] < MAX_JUMP_RAD).all(axis=1)",
    ): "differs only for a jump equal to the limit in all digits",
    (
        "heli_twin/identification/data.py",
        "if len(log.sent.time) < 3 or not len(t):",
    ): "two commands are too short for a stretch anyway",
    (
        "heli_twin/metrics/contact.py",
        "near = (np.hypot(apart[..., 0], apart[..., 1]) < 2.0 * RADIUS_M)"
        " & (np.abs(apart[..., 2]) <= BELOW_M + ABOVE_M)",
    ): "differs only for a height equal to the limit in all digits",
    (
        "heli_twin/lab/plant/airframe.py",
        "stick.delay = self.delay_steps / spec.option.timestep",
    ): "MuJoCo keeps as many samples as the delay is long: a longer delay gives the oldest of them too",
    (
        "heli_twin/lab/plant/contract.py",
        'does = "does nothing" if change >= -1e-6 else "acts the other way"',
    ): "differs only for a change equal to the limit in all digits",
    (
        "heli_twin/lab/plant/motion.py",
        "(q * up_y + r * up_z) / level if level else 1.0,",
    ): "read only where the nose points straight up in all digits, where there is no heading",
    (
        "controllers/reference.py",
        "flat[1, :, :2] = rotate_to_world(x[:, 4:7], yaw)",
    ): "a third component is not read",
    (
        "controllers/estimators/kalman.py",
        "self._stamp, self._age = -1, 1",
    ): "the first pose replaces both before they are read",
    (
        "controllers/line_process.py",
        'command = (which("setpriv") and "setpriv", "--pdeathsig", "KILL", "--")',
    ): "where it is on the path, its name finds it too",
    (
        "controllers/supervisors/safety.py",
        "if float(plan.x[0, 2]) <= spec.floor + 0.003 and float(plan.x[0, 6]) < 0.01:",
    ): "a plan that begins within 3 mm of the floor begins on it",
    (
        "heli_twin/lab/plant/contract.py",
        "step = TRIAL_STICK if u[i] + TRIAL_STICK < high[i] else -TRIAL_STICK",
    ): "differs only for a stick equal to the limit in all digits, and both directions are as good",
    (
        "heli_twin/lab/plant/contract.py",
        "if np.isfinite(moved.position).all() and abs(moved.position[2]) < FAR_M and change <= 1e-6:",
    ): "differs only for a change equal to the limit in all digits",
    (
        "controllers/reference.py",
        "allowed = (values > low - 1e-9) & (values <= high + 1e-9)",
    ): "differs only for a value equal to the limit in all digits",
    (
        "heli_twin/lab/plant/effects/stabiliser_bar.py",
        'spring.wrap_joint(f"bar_{name}", +1.0)',
    ): "the bar then turns the other way, and pulls the fuselage as before",
    (
        "heli_twin/lab/plant/effects/battery.py",
        "self._nominal = max(open_voltage(1.0) - spec.resistance * (spec.idle_current + spec.hover_current), 1.5)",
    ): "reached only by a cell that hovering takes all voltage of, which gives no thrust either way",
    (
        "heli_twin/lab/plant/airframe.py",
        'name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(5.0, 5.0, 0.1), contype=2, conaffinity=1',
    ): "what touches has contype 1, and touches by the floor's conaffinity",
    (
        "heli_twin/metrics/several.py",
        "away = np.linalg.norm(moved.state[:, :3] - goal, axis=1) >= ARRIVED_M",
    ): "differs only for a distance equal to the limit in all digits",
    (
        "heli_twin/metrics/margins.py",
        "kept = t >= t[-1] - records * probe.record + 1e-6",
    ): "differs only for a time that is 1 us after a sample in all digits",
    (
        "heli_twin/lab/plant/effects/payload.py",
        "body.mass, body.inertia, body.explicitinertial = self.mass, (1.5000000000000002e-09, 1e-9, 1e-9), True",
    ): "so small that it turns nothing",
    (
        "heli_twin/reporting/intervals.py",
        "mean, low, high, n = (column[0] for column in grouped_mean(np.zeros(len(values), np.int64), values, 2))",
    ): "one group too many is not read",
    (
        "heli_twin/reporting/intervals.py",
        "variance = np.where(variance < (1e-10 * mean) ** 2, 0.0, variance)",
    ): "differs only for a variance equal to the limit; 0 stays 0",
    (
        "heli_twin/metrics/response.py",
        "if best in (0, 2 * most) or misfit[far].min() - misfit[best] <= n * DISTINCT_RMS**2:",
    ): "differs only for a misfit equal to the limit in all digits",
    (
        "heli_twin/metrics/response.py",
        'misfit = squares - total**2 / n - 2.0 * np.correlate(r, y, "valid") - y @ y',
    ): "only differences of the misfit are used",
    (
        "heli_twin/metrics/response.py",
        "return [(a, b) for a, b in edges.reshape(-1, 2).tolist()"
        " if a == 0 or (b - a) * period > REST_DURATION_S - 1e-9]",
    ): "differs only for a duration equal to the limit in all digits",
    (
        "controllers/supervisors/safety.py",
        "if max(abs(x), abs(y)) >= spec.half_width or z > spec.height:",
    ): "differs only for a position equal to the limit in all digits",
    (
        "controllers/laws/detailed_mpc.py",
        "acting = Disturbances(gust, extra[10:13], push)",
    ): "there are twelve",
    (
        "heli_twin/lab/plant/mjcf_text.py",
        'if name.endswith("iterations") and not (value.isdecimal() and len(value) <= 9'
        " and int(value) <= MAX_ITERATIONS):",
    ): "any number of nine digits is above MAX_ITERATIONS too",
    (
        "heli_twin/lab/plant/mjcf_text.py",
        'if name.endswith("iterations") and not (value.isdecimal() and len(value) < 10'
        " and int(value) <= MAX_ITERATIONS):",
    ): "any number of nine or ten digits is above MAX_ITERATIONS too",
    (
        "controllers/laws/ltv_mpc.py",
        "A, B = np.split(model.discretise(model.jacobians(np.zeros((2, len(spec.Q)))))[0], [len(spec.Q)], axis=1)",
    ): "the first of two equal matrices is taken",
    (
        "heli_twin/metrics/margins.py",
        "lags = np.mod(_between(phase, crossings, share) - np.pi, 2.0 * np.pi)",
    ): "a whole turn less is the same angle",
    (
        "heli_twin/metrics/motion.py",
        "return np.zeros(0), np.zeros((0, 5))",
    ): "no rows of five columns are no rows",
    (
        "heli_twin/metrics/response.py",
        "if abs(step) >= MIN_STEP and np.ptp(reference[leaves : arrives + 1]) < abs(step) + 1e-6:",
    ): "differs only for an overshoot of the reference by 1e-6 in all digits",
    (
        "heli_twin/identification/data.py",
        "if len(log.sent.time) <= 2 or not len(t):",
    ): "two commands are too short for a stretch anyway",
    (
        "heli_twin/identification/fit.py",
        "delay, lag = float(min(np.arange(0.0, MAX_DELAY_S, 0.02), key=misfit)), 0.03",
    ): "the search begins there and ends elsewhere",
    (
        "controllers/laws/external.py",
        "SHOWN = 61",
    ): "a message shows one more character",
    (
        "heli_twin/reporting/intervals.py",
        "variance = np.where(variance <= (1.5e-10 * mean) ** 2, 0.0, variance)",
    ): "equal values scatter by less than a millionth of it",
    (
        "heli_twin/metrics/several.py",
        "def nearest(paths: Mapping[str, tuple[Array, Array]], axes: int = 4) -> Nearest | None:",
    ): "there are three",
    (
        "heli_twin/identification/fit.py",
        "if lag + step[1] <= 0.0:",
    ): "differs only for a lag of 0 in all digits",
    (
        "heli_twin/metrics/several.py",
        "goes_on = bool(np.linalg.norm(last.dz[0, :3]) >= STANDING_M_S)",
    ): "differs only for a speed equal to the limit in all digits",
    (
        "heli_twin/lab/disturbances/downwash.py",
        "above = below >= 0.0",
    ): "at the height of the rotors a jet has not begun",
    (
        "heli_twin/lab/disturbances/downwash.py",
        "below, aside = below[above], (position[:2] - others[above, :2])[:, None] - DISC",
    ): "the points of the disc lie alike on both sides",
    (
        "heli_twin/lab/plant/twin.py",
        "self._thrust_gain = model.actuator_gainprm[thrust, :4]",
    ): "a gain has three numbers",
    (
        "heli_twin/lab/plant/twin.py",
        "self._gyro_worked = False",
    ): "the gyro is told once more that it works",
    (
        "heli_twin/lab/plant/twin.py",
        "self._full_thrust, self._thrust_factor = self._thrust_gain.copy(), 1.5",
    ): "the first factor is written once more",
    (
        "heli_twin/lab/plant/twin.py",
        "self._own = root[model.geom_bodyid] != root[fuselage]",
    ): "of two shapes exactly one is a part of it, either way",
    (
        "heli_twin/lab/plant/twin.py",
        "foreign = np.array([i > 1 and not model.body(i).name.startswith(parts.prefix) for i in range(model.nbody)])",
    ): "the first body is a yaw frame, which has no shape",
    (
        "heli_twin/lab/plant/twin.py",
        "deepest = min((float(data.contact.dist[i]) for i in self._touching()), default=1.0)",
    ): "nothing touches either way",
    (
        "heli_twin/lab/plant/twin.py",
        "if deepest <= -0.002:",
    ): "differs only for a depth equal to the limit in all digits",
    (
        "heli_twin/identification/fit.py",
        "delay, lag = float(min(np.arange(0.0, MAX_DELAY_S, 0.03), key=misfit)), 0.02",
    ): "the search begins there and ends elsewhere",
    (
        "heli_twin/identification/fit.py",
        "if abs(step).max() <= 1e-6:",
    ): "differs only for a step equal to the limit in all digits",
    (
        "heli_twin/metrics/margins.py",
        "dense = np.linspace(at[0], at[-1], 4001)",
    ): "one frequency more between the measured ones",
    (
        "heli_twin/lab/plant/world.py",
        "own = edited(plant, visuals=True)",
    ): "the room discards what is only looked at",
    (
        "heli_twin/lab/plant/world.py",
        "data.qacc_warmstart[model.jnt_dofadr[i]] = 1.0",
    ): "any number lets the solver begin",
    (
        "heli_twin/lab/plant/world.py",
        "size=(RADIUS_M, 0.5 * (most - least), 1.0),",
    ): "a cylinder has two sizes",
    (
        "heli_twin/identification/fit.py",
        "for lag in range(1, min(lags, end - begin - 1) + 2):",
    ): "the weight of one lag more is 0",
    (
        "heli_twin/identification/data.py",
        "finite = np.isfinite(position).all(axis=1) & np.isfinite(q).all(axis=1)"
        " & (np.abs(q).max(axis=1, initial=0) >= 0.1)",
    ): "differs only for a quaternion equal to the limit in all digits",
    (
        "heli_twin/lab/plant/mjcf_text.py",
        "data = stream.read(most + 2)",
    ): "more than the limit is too much, by however many bytes",
    (
        "heli_twin/identification/fit.py",
        "return U[:, size >= SMALLEST_DIRECTION * size[0]] * size[0]",
    ): "differs only for a size equal to the limit in all digits",
    (
        "heli_twin/lab/plant/contract.py",
        "if speed > HOVER_M_S or turn >= HOVER_RAD_S:",
    ): "differs only for a speed equal to the limit in all digits",
    (
        "heli_twin/lab/plant/contract.py",
        'does = "does nothing" if change > -1.5e-06 else "acts the other way"',
    ): "a millionth of a metre per second is rounding either way",
    (
        "heli_twin/metrics/response.py",
        "r = r + r.mean()",
    ): "the mean of every window is taken off; this only keeps the sums small",
    (
        "controllers/pace.py",
        "rest = Jet.variable(np.where(t > 0.75 * end, length, 0.0), 0.0, order)",
    ): "it is read before the start and after the end only",
    (
        "heli_twin/metrics/response.py",
        "far = np.abs(np.arange(len(misfit)) - best) > most / 2",
    ): "a reference that repeats after half of MAX_LAG_S also repeats after the whole",
    (
        "heli_twin/lab/faults/pose_half_rate.py",
        "frame -= 1",
    ): "a count is divided by `every` without a rest whichever way it is counted",
    (
        "controllers/proxqp.py",
        "self._qp = proxqp.dense.QP(len(sample.g), 1, len(sample.C), True)",
    ): "one equation more, 0 x = 0",
    (
        "controllers/trajectories/doublets.py",
        'i = np.minimum(np.searchsorted(knots, since, side="right") - 1, len(h) + 1)',
    ): "a time modulo the last knot lies before it",
    (
        "heli_twin/identification/data.py",
        "if len(piece_t) and piece_t[-1] - piece_t[0] > MIN_STRETCH_S:",
    ): "differs only for a length equal to the limit in all digits",
    (
        "heli_twin/identification/fit.py",
        "if best <= needs.input:",
    ): "differs only for an excitation equal to the limit in all digits",
    (
        "heli_twin/identification/fit.py",
        "if own.std() <= needs.input:",
    ): "differs only for an excitation equal to the limit in all digits",
    (
        "heli_twin/identification/fit.py",
        "if same >= 1.0 - MIN_OWN_VARIANCE:",
    ): "differs only for a share equal to the limit in all digits",
    (
        "heli_twin/lab/plant/effects/payload.py",
        "apart = hook + empty[1]",
    ): "the hook is below the mast and the empty centre of gravity beside it: their distance has the same squares",
    (
        "controllers/reference.py",
        "value, limit = values[i, j], low[j] if values[i, j] <= low[j] else high[j]",
    ): "a value at its limit is no trouble, and is not named",
    (
        "heli_twin/lab/mocap.py",
        "yield from zip(displacements, turns, late, (uniforms <= spec.dropout).tolist(), strict=True)",
    ): "differs only for a draw equal to the share in all digits",
    (
        "heli_twin/lab/plant/contract.py",
        "if speed >= HOVER_M_S or turn > HOVER_RAD_S:",
    ): "differs only for a speed equal to the limit in all digits",
    (
        "heli_twin/lab/plant/contract.py",
        "high_up[2] = 150.0",
    ): "as far above the floor",
    (
        "heli_twin/metrics/several.py",
        "CYLINDER_HEIGHT_M = 0.44999999999999996",
    ): "a drawn height",
    (
        "controllers/coordinations/admm.py",
        "self._iterations, self._took, self._is_down = 0, 1, False",
    ): "a period begins with 0 before it is read",
    (
        "controllers/estimators/detailed_kalman.py",
        "if not isfinite(yaw - float(pose.position.sum())) or pose.stamp <= self._stamp:",
    ): "a difference is as finite as a sum",
    (
        "controllers/estimators/detailed_kalman.py",
        "if ahead <= 1:",
    ): "1 ns ahead is now",
    (
        "controllers/estimators/kalman.py",
        "return self._moved(x, acting, begin, until) if until >= begin else x",
    ): "in no time nothing moves",
    (
        "controllers/estimators/kalman.py",
        "push = self._push(begin) if begin + self._stamp > FADE_AFTER_NS else self._d",
    ): "before that time `_push` returns the same",
    (
        "controllers/laws/detailed_mpc.py",
        "AB, n = low_AB[1], len(HEIGHT_AND_YAW.states)",
    ): "all its matrices are equal",
    (
        "controllers/detailed_flatness.py",
        "still = self._stacked(at_rest, CALM)[1]",
    ): "both samples are at rest",
    (
        "controllers/laws/pid.py",
        "stuck = (value >= high and e >= 0.0) or (value <= low and e < 0.0)",
    ): "an error of 0 adds nothing",
    (
        "controllers/laws/pid.py",
        "stuck = (value >= high and e > 0.0) or (value <= low and e <= 0.0)",
    ): "an error of 0 adds nothing",
    (
        "controllers/planar.py",
        "_U = slice(6, 9)",
    ): "there are eight",
    (
        "controllers/pose_screen.py",
        "self._began = -2",
    ): "earlier than every pose",
    (
        "controllers/right_of_way.py",
        "steps_aside = asks and scene.wide[j, 1] <= self._manners.distance",
    ): "differs only in the turn in which the cameras lose one",
    (
        "controllers/splines.py",
        "velocity[-1] = slope[-1] + 0.5 * step[-1] * acceleration[-2]",
    ): "the line above makes both equal",
    (
        "controllers/supervisors/safety.py",
        "is_planned = float(plan.x[1, 2]) <= on_floor and bool((plan.x[:, 2] <= on_floor).all())",
    ): "the second half asks all rows",
    (
        "controllers/supervisors/safety.py",
        "if unsolved >= spec.solver_timeout:",
    ): "differs only for a time equal to the limit in all digits",
    (
        "controllers/supervisors/safety.py",
        "if self._stands(now, estimate, unseen >= spec.coast_after):",
    ): "differs only for a time equal to the limit in all digits",
    (
        "controllers/supervisors/safety.py",
        "if float(plan.x[0, 2]) < spec.floor + 0.002 and float(plan.x[0, 6]) < 0.01:",
    ): "differs only for a height equal to the limit in all digits",
    (
        "controllers/trajectories/waypoints.py",
        'if self.corners == "pass" or len(points) > 2:',
    ): "legs between stops are the shortest already: the factor is 1",
    (
        "controllers/trajectories/waypoints.py",
        "low, high = 1.0, _SHORTEST_LEG_S",
    ): "where the first time fits, it is taken; else both are replaced",
    (
        "controllers/trajectories/waypoints.py",
        "while low > 0.0 and high - low >= 1e-3 * high:",
    ): "differs only for a difference equal to the limit in all digits",
    (
        "controllers/coordinations/sequential.py",
        "more = near | (scene.room(knots) <= 0.0)",
    ): "differs only for a distance equal to the promised one in all digits",
    (
        "controllers/line_process.py",
        "self._errors = (self._errors + os.read(self._err, 65537))[-KEPT_ERROR_BYTES:]",
    ): "one more byte is read at once",
    (
        "controllers/line_process.py",
        "self._is_stuck = False",
    ): "a process that does not end is killed 2 s later",
    (
        "controllers/separation.py",
        "FINE = 5",
    ): "one more sample in each step is as safe",
    (
        "controllers/laws/detailed_mpc.py",
        "AB = plane[1]",
    ): "all its matrices are equal",
    (
        "controllers/coordinations/sequential.py",
        "if np.abs(old[1:, 0, axis] - target[:, axis]).max() >= 1e-9:",
    ): "differs only for a distance equal to the limit in all digits",
    (
        "controllers/coordinations/sequential.py",
        "near = scene.room(scene.old) <= NEAR_M",
    ): "differs only for a distance equal to the limit in all digits",
    (
        "controllers/proxqp.py",
        "return 2.0 ** max(1, round(log2(SMALLEST_CURVATURE / least)))",
    ): "another power of two scales the same problem",
    (
        "controllers/wish_plan.py",
        "slowed = since >= 0.0",
    ): "at that time the slowed clock reads and runs as the other",
    (
        "controllers/reference.py",
        "self._first, self._x, self._u = 0, np.empty((1, 8)), np.empty((0, 4))",
    ): "it is filled before it is read",
    (
        "controllers/reference.py",
        "if i < 1 or i + steps + 1 > len(self._x):",
    ): "it is filled once more with the same",
}
"""Mutations that change nothing a test could see: (module, mutated line without its indent) to the reason."""
EQUIVALENT_KINDS = {
    r"\bclean\(.*, \d*1\)": "a message shows one more character of it",
    r"^NEVER_NS = ": "later than every flight",
    r"\bPARKED_M\b": "what is parked out of the way meets nobody there, nor beside it",
    r"^BLOCK(_SAMPLES)? = ": "drawn or computed one more at a time, the numbers are the same",
    r"mjGEOM_PLANE, size=\((?!5\.0, 5\.0, 0\.1\))": "a floor is infinite: its size is drawn",
    r"^def .*, /, ": "what is given by name is given by name with `/` before it too",
    r"\breshape\(-2\b": "NumPy takes any negative length for the one that is left",
    r"\bstrict=False\b": "`strict` of `zip` guards against lengths that no caller gives",
    r"\blru_cache\((maxsize=)?\d+\)": "one more answer is kept",
    r"\bcolor=\d+\b": "another colour of a curve",
    r"\bfor _ in range\(\d+\)": "one more iteration of a search that has ended",
    r"(?:[-+<>]=? |, )1\.5\d*e-(?:0[6-9]|1\d)(?! \*)": "a millionth, or a guard against 0, half as large again",
    r"\brng=1\b": "another draw of the same bootstrap",
    r"\bn_resamples=1000\b": "one more resample of a bootstrap moves an interval by less than its own error",
}
"""Mutated lines of any module that change nothing a test could see, to the reason."""


class Mutation(NamedTuple):
    """One token of a module replaced."""

    file: str
    line: int
    """Counted from 1."""
    before: str
    after: str
    text: str
    """The whole mutated module."""


def replacement(token: tokenize.TokenInfo) -> str | None:
    if token.type == tokenize.NUMBER:
        value = ast.literal_eval(token.string)
        return repr(value + 1) if isinstance(value, int) else repr(1.5 * value or 1.0)
    return SWAPS.get(token.string) if token.type in (tokenize.OP, tokenize.NAME) else None


def unmutated_lines(tree: ast.AST) -> set[int]:
    """Of annotations, imports, decorators and defaults of fields: bounds, units, names, which other tests look at."""
    nodes: list[ast.AST] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.AnnAssign):
            nodes.append(node.annotation)
            if isinstance(node.value, ast.Constant):
                nodes.append(node.value)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            nodes.append(node)
        elif isinstance(node, ast.ClassDef):
            nodes.extend(node.decorator_list)
    return {line for node in nodes for line in range(node.lineno, (node.end_lineno or 0) + 1)}


def mutations(file: Path) -> Iterator[Mutation]:
    """Yield every mutation of a module that is valid Python."""
    source = file.read_text(encoding="utf-8")
    lines, left_out = source.splitlines(keepends=True), unmutated_lines(ast.parse(source))
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        new, (row, column) = replacement(token), token.start
        if new is None or row in left_out:
            continue
        before = lines[row - 1]
        after = before[:column] + new + before[token.end[1] :]
        text = "".join([*lines[: row - 1], after, *lines[row:]])
        try:
            ast.parse(text)
        except SyntaxError:
            continue
        yield Mutation(file.relative_to(ROOT).as_posix(), row, before.strip(), after.strip(), text)


def modules(room: str) -> list[Path]:
    paths = [ROOT / room] if room.endswith(".py") else sorted((ROOT / room).rglob("*.py"))
    return [path for path in paths if path.relative_to(ROOT).as_posix() not in PICTURES]


def nearest_tests(file: str) -> list[str]:
    """Return the test files of a module, nearest first.

    They have its name or its folder's, or import it; where none does, others import its package.
    """
    path = Path(file)
    further = [test for folder, tests in FOLDER_TESTS.items() if path.is_relative_to(folder) for test in tests]
    if file in OTHER_NAMES:
        return [f"tests/{name}" for name in OTHER_NAMES[file]] + further
    folder = ROOT / "tests" / path.parts[int(path.parts[0] == "heli_twin")]
    dotted = ".".join(path.with_suffix("").parts).removesuffix(".__init__")
    package, _, name = dotted.rpartition(".")
    names = [f"test_{name}.py", f"test_{path.parent.name}.py"]
    tests = _tests_of(folder, names, dotted) if folder.is_dir() else []
    tests = tests or _tests_of(ROOT / "tests", names[:1], dotted) or _tests_of(ROOT / "tests", [], package)
    return tests[:TEST_FILES] + further


def part_of(file: str) -> list[str]:
    """Return all tests of a module's part: the folder of its room, without what is nearest already."""
    path, nearest = Path(file), nearest_tests(file)
    folder = ROOT / "tests" / path.parts[int(path.parts[0] == "heli_twin")]
    tests = [test.relative_to(ROOT).as_posix() for test in sorted(folder.rglob("test_*.py"))] if folder.is_dir() else []
    return [test for test in tests if test not in nearest]


def _tests_of(folder: Path, names: Sequence[str], imported: str) -> list[str]:
    """The test files in a folder that have one of these names, or name what they import; short ones first."""
    tests: list[tuple[int, int, str]] = []
    for test in folder.rglob("test_*.py"):
        text = test.read_text(encoding="utf-8")
        if test.name in names or re.search(rf"\b{re.escape(imported)}\b", text):
            near = names.index(test.name) if test.name in names else len(names)
            tests.append((near, len(text), test.relative_to(ROOT).as_posix()))
    return [test for *_, test in sorted(tests)]


PYTEST_WORDS = ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
"""Plugins are already imported in a fork."""


def equivalent(mutation: Mutation) -> bool:
    kinds = [kind for kind in EQUIVALENT_KINDS if re.search(kind, mutation.after)]
    return (mutation.file, mutation.after) in EQUIVALENT or bool(kinds)


class Watch:
    """A pytest plugin: it tells which test runs, limits its processor time and leaves failures as they are."""

    def __init__(self, pipe: int):
        self.pipe = pipe

    def pytest_sessionstart(self):
        from hypothesis import Phase, settings

        settings.register_profile("mutants", settings.get_profile("ci"), phases=[Phase.explicit, Phase.generate])
        settings.load_profile("mutants")

    def pytest_runtest_logstart(self, nodeid: str):
        os.write(self.pipe, f"{nodeid}\n".encode())
        limit = int(time.process_time()) + TEST_CPU_LIMIT_S
        resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.RLIM_INFINITY))


class Outcome(NamedTuple):
    """Of some tests: pytest's exit code, or a negative signal, and the last test begun."""

    code: int
    test: str


def tested(tests: Sequence[str]) -> Outcome:
    """Return the outcome of tests run to the first failure, in a fork of this process."""
    import pytest

    reader, writer = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reader)
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        code = 1
        try:
            code = int(
                pytest.main(["-x", "-q", "-p", "no:cacheprovider", *PYTEST_WORDS, *tests], plugins=[Watch(writer)])
            )
        finally:
            os._exit(code)
    os.close(writer)
    begun = b""
    while part := os.read(reader, 1 << 16):
        begun += part
    os.close(reader)
    lines = begun.decode().splitlines()
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return Outcome(code, lines[-1] if lines else "collection")


def copy_of_the_repository(folder: Path) -> None:
    for name in ("controllers", "heli_twin", "models", "tests"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, folder)
    # By the hash of the source: a mutant may have the size and the second of the original.
    words = [
        sys.executable,
        "-m",
        "compileall",
        "-q",
        "--invalidation-mode",
        "checked-hash",
        "controllers",
        "heli_twin",
    ]
    subprocess.run(words, cwd=folder, check=True)


def survivors(room: str, count: int, seed: int = 0) -> Iterator[tuple[Mutation, bool, str]]:
    """Yield of each sampled mutation whether it survives its tests, and the test that notices it.

    Raises:
        RuntimeError: A test that fails with a mutant fails without it too.
    """
    every = [mutation for file in modules(room) for mutation in mutations(file)]
    sample = random.Random(seed).sample(every, min(count, len(every)))
    nearest, sound = {mutation.file: nearest_tests(mutation.file) for mutation in sample}, set[str]()
    for mutation in sample:
        if equivalent(mutation):
            continue
        mutated = Path(mutation.file)
        original = mutated.read_text(encoding="utf-8")
        mutated.write_text(mutation.text, encoding="utf-8")
        tests = nearest[mutation.file]
        # Nothing notices what has no tests.
        outcome = tested(tests) if tests else Outcome(0, "")
        if outcome.code == 0 and (further := part_of(mutation.file)):
            outcome = tested(further)
        mutated.write_text(original, encoding="utf-8")
        test = "" if outcome.code == 0 else outcome.test
        if test and test not in sound:
            if tested([test] if "::" in test else ["--collect-only", *tests]).code != 0:
                raise RuntimeError(f"{test} of {tests} fails without a mutation too")
            sound.add(test)
        yield mutation, outcome.code == 0, test + " (out of time)" * (outcome.code == -signal.SIGXCPU)


def prepare(folder: Path) -> None:
    """Import the libraries, and go where the mutants are tested."""
    os.environ["OMP_NUM_THREADS"] = "1"
    os.environ["PYTHONPATH"] = str(folder)
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    sys.dont_write_bytecode = True
    for library in LIBRARIES.split():
        __import__(library)
    sys.path[0] = str(folder)
    os.chdir(folder)


def main(room: str, count: str = "50", seed: str = "0") -> None:
    """Print one line a mutant: its outcome, module, line, test and time; then, for survivors, both lines."""
    with tempfile.TemporaryDirectory() as name:
        copy_of_the_repository(Path(name))
        prepare(Path(name))
        began = time.monotonic()
        for mutation, survives, test in survivors(room, int(count), int(seed)):
            place = f"{time.monotonic() - began:4.0f} s  {mutation.file}:{mutation.line}"
            lines = f"\n    - {mutation.before}\n    + {mutation.after}"
            print(f"SURVIVES {place}{lines}" if survives else f"killed   {place}  {test}", flush=True)
            began = time.monotonic()


if __name__ == "__main__":
    main(*sys.argv[1:])
