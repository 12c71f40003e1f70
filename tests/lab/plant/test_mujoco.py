import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.model import GRAVITY, Model, advance
from heli_twin.lab.plant import STILL_AIR, Air, physical_state
from heli_twin.lab.plant.motion import FreeJoint, Gimbal
from heli_twin.lab.plant.mujoco import MuJoCo, edited, engine, model_file
from heli_twin.lab.plant.twin import rotated_to_world

MS = 1_000_000
SECOND = 1000 * MS
PAPER = Model()
NOMINAL = MuJoCo()
HOVER = np.array(NOMINAL.trim)
AT_ONCE = {"servo_lag": 0.0, "thrust_lag": 0.0, "yaw_lag": 0.0, "input_delay": 0.0}


def at(height=1.0, **states):
    """A state (8,), zero but for what is named."""
    names = ("x", "y", "z", "yaw", "vx", "vy", "vz", "yaw_rate")
    return np.array([float({"z": height, **states}.get(name, 0.0)) for name in names])


def fly(spec, x, inputs, air=STILL_AIR, period=20 * MS):
    """The truth after every period of a flight with `inputs` (N, 4)."""
    plant = spec.start(x)
    truths = []
    for k, u in enumerate(inputs, 1):
        plant.advance(k * period, u, air)
        truths.append(plant.truth())
    return truths


def held(u, seconds, spec=NOMINAL, x=None, air=STILL_AIR):
    """The truth after holding HOVER + u."""
    plant = spec.start(at(300.0) if x is None else x)
    plant.advance(round(seconds * SECOND), HOVER + u, air)
    return plant.truth()


def mast(truth):
    """Direction of the mast in the yaw frame (3,), from the attitude quaternion."""
    w, x, y, z = truth.quat_wxyz
    up = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    c, s = np.cos(truth.yaw), np.sin(truth.yaw)
    return np.array([c * up[0] + s * up[1], c * up[1] - s * up[0], up[2]])


def wobbly(n, seed=0):
    """Inputs (n, 4) that excite every axis."""
    t = 0.02 * np.arange(n)
    phase = np.random.default_rng(seed).uniform(0, 6, 4)
    return HOVER + np.array([0.3, 0.3, 0.1, 0.1]) * np.sin(np.outer(t, [5.0, 7.0, 6.0, 9.0]) + phase)


# --- trim -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "spec",
    [
        NOMINAL,
        MuJoCo(mass=0.031, thrust_gain=0.47),
        MuJoCo(pitch_trim=0.1, roll_trim=-0.07, yaw_trim=0.04),
        MuJoCo(input_delay=0.015, thrust_lag=0.1),
        MuJoCo(**AT_ONCE),
        MuJoCo(drag_z=0.04, step=0.0005),
    ],
)
def test_hover_is_an_equilibrium(spec):
    plant = spec.start(at(yaw=0.6))
    plant.advance(10 * SECOND, np.array(spec.trim), STILL_AIR)
    # Thrust minus weight is rounding: 1e-16 relative, so 5e-14 m after 10 s.
    np.testing.assert_allclose(physical_state(plant.truth()), at(yaw=0.6), atol=1e-12)


def test_ten_percent_more_mass_needs_ten_percent_more_throttle():
    heavy = replace(NOMINAL, mass=1.1 * NOMINAL.mass)
    assert heavy.trim[2] == pytest.approx(1.1 * NOMINAL.trim[2], rel=1e-12)
    # Under the nominal throttle, a tenth of its weight over 1.1 masses is missing; after 5 s no lag is left, and the
    # 60 ms during which the rotors slowed down are worth 0.05 m/s.
    assert held(0, 5.0, heavy).velocity[2] == pytest.approx(-GRAVITY * 5.0 * 0.1 / 1.1, abs=0.06)


def test_a_helicopter_too_heavy_to_hover_has_full_throttle_as_its_trim():
    assert MuJoCo(mass=2.0 * NOMINAL.mass).trim[2] == 1.0


def test_a_flat_plate_is_a_rigid_body():
    """Its inertia about its normal is the sum of the two others, whose double is exact."""
    plate = MuJoCo(inertia_xx=3e-5, inertia_yy=3e-5, inertia_zz=6e-5)
    assert plate.inertia_zz == 2 * plate.inertia_xx


def test_it_starts_in_the_state_it_is_given():
    x = np.array([0.3, -0.2, 1.0, 2.5, 0.5, -0.4, 0.1, 1.5])
    truth = NOMINAL.start(x).truth()
    np.testing.assert_allclose(physical_state(truth), x, atol=1e-15)
    np.testing.assert_array_equal(truth.actuators, HOVER)
    np.testing.assert_allclose(mast(truth), [0, 0, 1], atol=1e-15)


# --- steady state is the paper's -------------------------------------------------------------------------------------


@pytest.mark.parametrize("stick", [-0.5, 0.5, 1.0])
def test_steady_tilt_follows_from_the_gains(stick):
    # The slower mode decays with zeta w = 7 1/s: 1e-12 after 4 s, some 1e-10 with its growth from the start.
    assert mast(held([stick, 0, 0, 0], 4.0))[0] == pytest.approx(PAPER.b_x * stick / GRAVITY, abs=1e-9)
    assert mast(held([0, stick, 0, 0], 4.0))[1] == pytest.approx(PAPER.b_y * stick / GRAVITY, abs=1e-9)


@pytest.mark.parametrize("stick", [-0.5, 0.5])
def test_speed_settles_at_gain_over_drag(stick):
    # exp(-0.4 * 60) = 4e-11 of the way is left; 60 s of sinking under the tilted mast are 90 m of the 300.
    vx, vy, *_ = physical_state(held([stick, 0, 0, 0], 60.0))[4:]
    assert (vx, vy) == pytest.approx((-PAPER.b_x / PAPER.k_x * stick, 0.0), abs=1e-8)
    vx, vy, *_ = physical_state(held([0, stick, 0, 0], 60.0))[4:]
    assert (vx, vy) == pytest.approx((0.0, -PAPER.b_y / PAPER.k_y * stick), abs=1e-8)


@pytest.mark.parametrize("stick", [-0.4, 0.4])
def test_yaw_rate_settles_at_gain_over_damping(stick):
    # exp(-5 * 6) = 1e-13 of 9 rad/s is left.
    assert held([0, 0, 0, stick], 6.0).yaw_rate == pytest.approx(-PAPER.b_yaw / PAPER.k_yaw * stick, abs=1e-10)


@pytest.mark.parametrize("stick", [-0.1, 0.1])
def test_climb_accelerates_with_the_thrust_gain(stick):
    climb = held([0, 0, stick, 0], 3.0).velocity[2] - held([0, 0, stick, 0], 2.0).velocity[2]
    # exp(-2 / 0.06) of the step is left at 2 s: 3e-15.
    assert climb == pytest.approx(PAPER.b_z * stick, abs=1e-10)


@pytest.mark.parametrize(
    ("index", "velocity", "positive"),
    [(0, 0, "to the nose"), (1, 1, "to port"), (2, 2, "up")],
)
def test_positive_sticks_push_along_positive_axes(index, velocity, positive):
    u = np.zeros(4)
    u[index] = 0.1
    assert held(u, 1.0).velocity[velocity] > 0.05, positive


def test_positive_yaw_stick_turns_the_nose_to_port():
    truth = held([0, 0, 0, 0.1], 0.4)
    assert truth.yaw > 0.1
    # Then forward flight, along the nose, has gone to the west.
    assert held([0.3, 0, 0, 0], 2.0, x=at(300.0, yaw=np.pi / 2)).position[1] > 0.1


@pytest.mark.parametrize(("axis", "b", "k"), [(0, PAPER.b_x, PAPER.k_x), (1, PAPER.b_y, PAPER.k_y)])
@pytest.mark.parametrize(
    ("spec", "skipped"),
    [
        # exp(-7 * 1) = 1e-3 of the attitude's transient is left after 1 s.
        (NOMINAL, 50),
        # 2 ms of attitude against a first period of 20 ms, one of 1000.
        (MuJoCo(attitude_frequency=1000.0, attitude_damping=1.0, **AT_ONCE), 0),
    ],
)
def test_identification_returns_the_paper_s_parameters(axis, b, k, spec, skipped):
    u = np.zeros(4)
    u[axis] = 0.5
    v = np.array([0.0, *(t.velocity[axis] for t in fly(spec, at(300.0), [HOVER + u] * 1000))])[skipped:]
    # v' = b u + k v, over every period of a step response.
    regressors = np.stack([np.full(len(v) - 1, 0.5), 0.5 * (v[1:] + v[:-1])], axis=1)
    found, *_ = np.linalg.lstsq(regressors, np.diff(v) / 0.02, rcond=None)
    np.testing.assert_allclose(found, [b, k], rtol=0.003)


# --- the limit of fast attitude --------------------------------------------------------------------------------------


def allocated(u):
    """The input for which the tilted rotors' force has the components along the yaw frame that (1) prescribes."""
    force = np.array([PAPER.b_x * u[0], PAPER.b_y * u[1], PAPER.b_z * u[2]])
    total = np.linalg.norm(force)
    cos_pitch = force[2] / np.hypot(force[0], force[2])
    tilt = GRAVITY * force / total
    return np.array([tilt[0] / PAPER.b_x, tilt[1] * cos_pitch / PAPER.b_y, total / PAPER.b_z, u[3]])


def distance_to_the_model(step, start, inputs):
    """Largest difference to (1) of each state over a flight with attitude as fast as the step allows, and no lags."""
    spec = MuJoCo(
        step=step,
        attitude_frequency=1.0 / step,
        attitude_damping=1.0,
        # A sphere: tilting about one axis at a time then has no hold on the yaw.
        inertia_xx=2.7e-5,
        inertia_yy=2.7e-5,
        **AT_ONCE,
    )
    x, expected = tuple(start), []
    for u in inputs:
        x = advance(PAPER, x, tuple(u), 0.02)
        expected.append(x)
    flown = [physical_state(t) for t in fly(spec, start, [allocated(u) for u in inputs])]
    return np.abs(np.array(flown) - np.array(expected)).max(axis=0)


def test_twin_reduces_to_the_model():
    # 2 s: pitching first, then level, then rolling; turning and climbing throughout.
    t = 0.02 * np.arange(100)
    pitching, rolling = t < 1.0, t >= 1.1
    inputs = np.stack(
        [
            np.where(pitching, 0.2 + 0.6 * np.sin(5 * t), 0.0),
            np.where(rolling, 0.5 * np.cos(7 * t) - 0.2, 0.0),
            0.545 + 0.15 * np.sin(6 * t),
            0.1 + 0.2 * np.sin(9 * t),
        ],
        axis=1,
    )
    start = np.array([0.1, -0.2, 50.0, 0.4, 0.3, -0.1, 0.2, 0.5])
    steps = [2e-3, 1e-3, 5e-4, 2.5e-4]
    distances = np.array([distance_to_the_model(step, start, inputs) for step in steps])
    # First order: the integrator is, and the attitude lags by 2 / frequency = 2 steps. Halving the step halves it.
    order = np.log2(distances[:-1] / distances[1:])
    np.testing.assert_allclose(order, 1.0, atol=0.25)
    # Two steps of lag against speeds of 1 m/s, 4 rad/s and accelerations of 2 m/s^2, 30 rad/s^2.
    assert distances[-1, :3].max() < 1e-3
    assert distances[-1, 3] < 2e-3


# --- determinism and time --------------------------------------------------------------------------------------------


def test_same_start_and_inputs_same_flight():
    a, b = (fly(NOMINAL, at(), wobbly(100)) for _ in range(2))
    for one, other in zip(a, b, strict=True):
        assert_same(one, other)


@settings(max_examples=20)
@given(
    st.lists(st.integers(0, 100), min_size=1, max_size=6),
    st.sampled_from([0.0, 0.002, 0.007, 0.03]),
    st.integers(0, 100),
)
def test_a_flight_in_pieces_is_the_flight_at_once(stops, delay, seed):
    spec = replace(NOMINAL, input_delay=delay)
    air = Air(np.array([0.4, -0.3, 0.2]), np.array([0.1, 0.05, 0.0]), 0.97)
    once, pieces = (spec.start(at(vx=0.3, yaw_rate=4.0)) for _ in range(2))
    for k, u in enumerate(wobbly(3, seed), 1):
        once.advance(k * 100 * MS, u, air)
        for ms in [*sorted(stops), 100]:
            pieces.advance(((k - 1) * 100 + ms) * MS, u, air)
            pieces.truth()
    assert_same(once.truth(), pieces.truth())


@pytest.mark.parametrize("step", [0.0005, 0.001, 0.002])
@pytest.mark.parametrize("steps", [0, 1, 2, 7, 31])
def test_an_input_acts_after_exactly_the_delay(step, steps):
    spec = MuJoCo(step=step, **{**AT_ONCE, "input_delay": steps * step})
    plant = spec.start(at())
    noise = np.random.default_rng(0).uniform(0, 1, 600)
    reached = []
    for k, throttle in enumerate(noise, 1):
        plant.advance(k * spec.step_ns, np.array([0, 0, throttle, 0]), STILL_AIR)
        reached.append(plant.truth().actuators[2])
    # A lag of zero is computed as an exponential: rounding.
    np.testing.assert_allclose(reached[:steps], np.full(steps, spec.trim[2]), atol=1e-14)
    np.testing.assert_allclose(reached[steps:], noise[: len(noise) - steps], atol=1e-14)


def test_the_attitude_may_move_two_radians_a_step_and_no_more():
    """An undamped oscillator is stable up to there: at 2 it oscillates on, above it grows without limit."""
    equal = {"inertia_xx": 1e-5, "inertia_yy": 1e-5, "inertia_zz": 2e-5, "step": 0.002}
    assert MuJoCo(attitude_frequency=1000.0, **equal).step == 0.002
    with pytest.raises(ValueError, match="is too fast for a step"):
        MuJoCo(attitude_frequency=1000.0000001, **equal)


@pytest.mark.parametrize("length", [0.5, 1.0, 2.0])
def test_a_free_joint_is_read_whatever_the_length_of_its_quaternion(length):
    """Between two physics steps the engine keeps it; it is normalised all the same."""
    pose = np.array([1.0, 2.0, 3.0, length * np.cos(0.2), 0.0, 0.0, length * np.sin(0.2)])
    data = SimpleNamespace(qpos=pose, qvel=np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]))
    joint = FreeJoint(SimpleNamespace(), data, None)
    joint.place(np.array([0.0] * 8))
    data.qpos[:] = [1.0, 2.0, 3.0, length * np.cos(0.2), 0.0, 0.0, length * np.sin(0.2)]
    data.qvel[:] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    now = joint.now()
    np.testing.assert_allclose(now.quat_wxyz, [np.cos(0.2), 0.0, 0.0, np.sin(0.2)], rtol=1e-12)
    assert (now.yaw, now.yaw_rate) == pytest.approx((0.4, 0.6))
    # What has diverged has no attitude, and a heading of 0.
    data.qpos[3:] = 0.0
    assert joint.now().quat_wxyz.tolist() == [0.0] * 4


@given(st.floats(-3, 3), st.floats(-1.4, 1.4), st.floats(-3, 3))
def test_a_vector_of_the_body_is_turned_by_yaw_pitch_and_roll(yaw, pitch, roll):
    (cy, cp, cr), (sy, sp, sr) = np.cos([yaw, pitch, roll]), np.sin([yaw, pitch, roll])
    Rz, Ry = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]), np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    Rx = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    data = SimpleNamespace(qpos=np.array([0, 0, 0, yaw, pitch, roll]), qvel=np.zeros(6))
    quat = Gimbal(SimpleNamespace(jnt_qposadr=[0], jnt_dofadr=[0], dof_damping=np.zeros(6)), data).now().quat_wxyz
    for vector in np.eye(3):
        np.testing.assert_allclose(rotated_to_world(quat, vector), Rz @ Ry @ Rx @ vector, atol=1e-12)


@given(*[st.floats(-1.3, 1.3)] * 3, *[st.floats(-5, 5)] * 3)
def test_the_angular_velocity_is_the_change_of_the_attitude(yaw, pitch, roll, r, pitch_rate, roll_rate):
    angles, rates, dt = np.array([yaw, pitch, roll]), np.array([r, pitch_rate, roll_rate]), 1e-6

    def gimbal(at):
        data = SimpleNamespace(qpos=np.array([0, 0, 0, *at]), qvel=np.array([0, 0, 0, *rates]))
        return Gimbal(SimpleNamespace(jnt_qposadr=[0], jnt_dofadr=[0], dof_damping=np.zeros(6)), data).now()

    before, after = (gimbal(angles + sign * dt * rates).quat_wxyz for sign in (-1, 1))
    turned = before[0] * after[1:] - after[0] * before[1:] - np.cross(before[1:], after[1:])
    # Central differences of rates of up to 10 rad/s.
    np.testing.assert_allclose(turned / dt, gimbal(angles).angular_velocity, atol=1e-7)


def test_a_lag_is_first_order():
    truth = held([0.2, 0.2, 0.2, 0.2], 0.032)
    # 30 ms after the 2 ms of delay, at the new value in the sampled sense: exact for a held input.
    expected = HOVER + 0.2 * (1 - np.exp(-0.030 / np.array([0.03, 0.03, 0.06, 0.005])))
    np.testing.assert_allclose(truth.actuators, expected, atol=1e-12)


def assert_same(one, other):
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


# --- truth -----------------------------------------------------------------------------------------------------------


# The second turns at 4 rad/s while it leans by 0.17 rad to the side.
@pytest.mark.parametrize("inputs", [wobbly(1500), np.tile(np.add(HOVER, [0.0, 0.8, 0.0, 0.2]), (1500, 1))])
def test_truth_is_consistent(inputs):
    before, after = fly(NOMINAL, at(5.0, yaw_rate=2.0), inputs, period=MS)[-2:]
    # The integrator moves positions with the newest velocity.
    np.testing.assert_allclose((after.position - before.position) / 1e-3, after.velocity, atol=1e-9)
    w0, v0, w1, v1 = before.quat_wxyz[0], before.quat_wxyz[1:], after.quat_wxyz[0], after.quat_wxyz[1:]
    turned = 2 * (w0 * v1 - w1 * v0 - np.cross(v0, v1))
    # Half a step of an angular acceleration of some 50 rad/s^2.
    np.testing.assert_allclose(turned / 1e-3, after.angular_velocity, atol=0.05)
    assert np.linalg.norm(after.quat_wxyz) == pytest.approx(1.0, abs=1e-15)


def test_truth_is_the_caller_s_to_keep():
    plant = NOMINAL.start(at())
    before = plant.truth()
    kept = [np.copy(value) for value in before]
    plant.advance(SECOND, wobbly(1)[0], STILL_AIR)
    for a, b in zip(before, kept, strict=True):
        np.testing.assert_array_equal(a, b)


def test_yaw_is_unwrapped():
    assert held([0, 0, 0, 0.4], 10.0).yaw > 6 * np.pi


# --- air -------------------------------------------------------------------------------------------------------------


def test_wind_drags_along():
    wind = np.array([0.8, -0.5, 0.3])
    truth = held(0, 40.0, replace(NOMINAL, drag_z=0.0112), air=Air(wind, np.zeros(3)))
    # exp(-0.4 * 40) of 1 m/s is left.
    np.testing.assert_allclose(truth.velocity, wind, atol=1e-6)


def test_steady_wind_is_a_moving_frame():
    """Also while it turns fast: the wind stays fixed to the room at every physics step."""
    wind = np.array([0.8, -0.5, 0.4])
    spec = replace(NOMINAL, drag_z=0.04)
    still = fly(spec, at(20.0, yaw_rate=15.0), wobbly(100))[-1]
    windy = fly(spec, at(20.0, vx=wind[0], vy=wind[1], vz=wind[2], yaw_rate=15.0), wobbly(100), Air(wind, np.zeros(3)))[
        -1
    ]
    # The same forces but for the rounding of a velocity difference, over 2000 steps.
    np.testing.assert_allclose(windy.velocity - wind, still.velocity, atol=1e-10)
    np.testing.assert_allclose(windy.position - 2.0 * wind, still.position, atol=1e-10)
    np.testing.assert_allclose(windy.quat_wxyz, still.quat_wxyz, atol=1e-10)


def test_a_push_accelerates_whatever_the_mass():
    push = np.array([0.0, 0.0, 0.3])
    spec = replace(NOMINAL, mass=0.035)
    plant = spec.start(at())
    plant.advance(2 * SECOND, np.array(spec.trim), Air(np.zeros(3), push))
    # Constant acceleration is summed exactly but for rounding.
    assert plant.truth().velocity[2] == pytest.approx(0.6, abs=1e-10)


def test_a_moment_acts_as_long_as_it_blows():
    once, never = NOMINAL.start(at()), NOMINAL.start(at())
    once.advance(20 * MS, HOVER, Air(np.zeros(3), np.zeros(3), moment=np.zeros(3)))
    never.advance(20 * MS, HOVER, STILL_AIR)
    for plant in (once, never):
        plant.advance(100 * MS, HOVER, STILL_AIR)
    assert_same(once.truth(), never.truth())
    once.advance(120 * MS, HOVER, Air(np.zeros(3), np.zeros(3), moment=np.array([1e-5, 0.0, 0.0])))
    assert not once._data.xfrc_applied.any()
    assert once.truth().angular_velocity[0] > 0.001
    assert once.feels_moments


def test_thrust_factor_scales_thrust():
    truth = held(0, 1.0, air=Air(np.zeros(3), np.zeros(3), 0.9))
    assert truth.velocity[2] == pytest.approx(-0.1 * GRAVITY, abs=1e-10)
    np.testing.assert_array_equal(truth.actuators, HOVER)


def test_drag_does_not_make_it_climb():
    """Drag acts in the yaw frame: along a tilted nose it would lift a helicopter that flies fast."""
    early, late = held([0.8, 0.0, 0, 0], 20.0), held([0.8, 0.0, 0, 0], 21.0)
    climb = late.velocity[2] - early.velocity[2]
    # What the tilted mast carries less is all there is, g (cos(tilt) - 1).
    assert climb == pytest.approx(GRAVITY * (mast(late)[2] - 1.0), abs=1e-9)


# --- floor -----------------------------------------------------------------------------------------------------------


def test_it_rests_on_its_skids():
    truths = fly(NOMINAL, at(0.2), [np.zeros(4)] * 100)
    assert not truths[0].touching
    truth = truths[-1]
    assert truth.touching
    # The skids reach 45 mm below the centre of gravity; the floor gives way by less than half a millimetre.
    assert truth.position[2] == pytest.approx(0.045, abs=5e-4)
    np.testing.assert_allclose(mast(truth), [0, 0, 1], atol=1e-3)
    assert np.abs(truth.velocity).max() < 1e-4


def test_it_takes_off_again():
    plant = NOMINAL.start(at(0.0451))
    plant.advance(SECOND, np.zeros(4), STILL_AIR)
    plant.advance(2 * SECOND, HOVER + np.array([0, 0, 0.1, 0]), STILL_AIR)
    truth = plant.truth()
    assert not truth.touching
    assert truth.position[2] > 0.3


def test_a_crash_stays_above_the_floor_and_finite():
    flat_out = np.array([1.0, 1.0, 0.3, 1.0])
    for truth in fly(NOMINAL, at(0.5, vx=3.0), [flat_out] * 300):
        assert np.isfinite(physical_state(truth)).all()
        # No lower than the hull allows on its side: the fin and the canopy keep the centre 2 cm up.
        assert truth.position[2] > 0.015


def test_a_start_in_the_floor_is_refused():
    told = r"at a height of 0.02 m the helicopter would stand 0.025 m in the floor: start higher"
    with pytest.raises(ValueError, match=told):
        NOMINAL.start(at(0.02))
    # Two millimetres are the give of skids and floor.
    assert NOMINAL.start(at(0.0431)).truth().touching
    with pytest.raises(ValueError, match=r"would stand 0\.0021 m in the floor"):
        NOMINAL.start(at(0.0429))


# --- what cannot be flown --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("until", "u"), [(1_500_000, HOVER), (-MS, HOVER), (MS, np.array([0, np.nan, 0, 0]))])
def test_what_cannot_be_flown_is_refused(until, u):
    with pytest.raises(ValueError, match=r"until|finite"):
        NOMINAL.start(at()).advance(until, u, STILL_AIR)


def test_a_time_between_two_steps_is_told_with_now_and_the_step():
    plant = NOMINAL.start(at())
    for until in (20 * MS, 20 * MS):
        plant.advance(until, HOVER, STILL_AIR)
        assert plant.truth().stamp == until
    with pytest.raises(ValueError, match="until = 20500000 ns has to be 20000000 ns plus whole steps of 1000000 ns"):
        plant.advance(20_500_000, HOVER, STILL_AIR)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        # Roll is faster, by the root of 3.9 over 2.8: 5901 rad/s.
        (
            {"attitude_frequency": 5000.0},
            r"take a step of at most 0\.00034 s, or a frequency of at most 1695 rad/s",
        ),
        ({"step": 1 / 3000}, "whole number of nanoseconds"),
        ({"inertia_yy": 9e-5}, "no rigid body"),
    ],
)
def test_specs_that_cannot_be_simulated_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        MuJoCo(**wrong)


def test_the_fastest_attitude_allowed_is_stable():
    spec = MuJoCo(attitude_frequency=1690.0, attitude_damping=0.1, **AT_ONCE)
    sticks = np.random.default_rng(0).uniform([-1, -1, 0.4, -1], [1, 1, 0.7, 1], (250, 4))
    # A step of one stick from end to end overshoots to 0.2 + 0.4 * 0.73; both at once, 1.4 times that.
    assert max(np.linalg.norm(mast(t)[:2]) for t in fly(spec, at(100.0), sticks)) < 0.7


def test_the_sticks_clip_what_they_are_asked():
    plant = MuJoCo(**AT_ONCE).start(at())
    plant.advance(MS, np.array([3.0, -2.0, -1.0, 5.0]), STILL_AIR)
    np.testing.assert_allclose(plant.truth().actuators, [1.0, -1.0, 0.0, 1.0], atol=1e-14)


def test_a_lost_flight_is_not_put_back_to_its_start(tmp_path, monkeypatch):
    """Nor does the engine leave files where it ran."""
    monkeypatch.chdir(tmp_path)
    plant = NOMINAL.start(at())
    for k in range(1, 4):
        plant.advance(k * 20 * MS, HOVER, Air(np.zeros(3), np.array([1e16, 0.0, 0.0])))
    assert not abs(plant.truth().position[0]) < 1e6
    assert list(tmp_path.iterdir()) == []


# --- the model file --------------------------------------------------------------------------------------------------


def test_the_file_alone_hovers_with_the_nominal_numbers():
    mujoco = engine()
    model = mujoco.MjModel.from_xml_path(str(model_file()))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("hover").id)
    mujoco.mj_step(model, data, 5000)
    # Its trim is rounded to six digits.
    np.testing.assert_allclose(data.qpos[:6], [0, 0, 1, 0, 0, 0], atol=1e-3)
    default = edited(NOMINAL, visuals=True).compile()
    # The file's numbers carry five digits or more.
    for name in ("body_mass", "body_inertia", "dof_damping", "actuator_gainprm", "actuator_biasprm", "actuator_dynprm"):
        np.testing.assert_allclose(getattr(model, name), getattr(default, name), rtol=2e-5, atol=1e-9, err_msg=name)
    assert model.opt.gravity[2] == -GRAVITY


def test_what_is_only_looked_at_does_not_fly():
    seen, blind = (edited(NOMINAL, visuals=visuals).compile() for visuals in (True, False))
    assert seen.ngeom > 3 * blind.ngeom
    np.testing.assert_array_equal(seen.body_mass, blind.body_mass)
    assert (seen.geom_contype != 0).sum() == (blind.geom_contype != 0).sum()


def test_the_description_is_the_model_that_flew():
    spec = replace(NOMINAL, mass=0.031, drag_x=0.02, input_delay=0.005)
    model = engine().MjModel.from_xml_string(spec.start(at()).description())
    assert model.body("fuselage").mass[0] == pytest.approx(0.031, rel=1e-9)
    assert model.actuator("drag_x").biasprm[2] == -0.02
    assert model.ngeom > 20


def test_the_spec_alone_does_not_load_the_engine():
    code = "import sys, heli_twin.lab.plant.mujoco as m; m.MuJoCo(); assert 'mujoco' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_physics_step_reads_no_clock():
    twin = MuJoCo().start(np.array([0.0, 0, 1, 0, 0, 0, 0, 0]))
    twin.advance(20_000_000, np.array(MuJoCo().trim), STILL_AIR)
    assert not twin._data.timer.duration.any()
