from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest

from controllers.model import GRAVITY
from heli_twin.experiment.families import members
from heli_twin.experiment.text import load
from heli_twin.experiment.tree import canonical_json, from_json
from heli_twin.lab.plant import STILL_AIR, Air, Battery, physical_state
from heli_twin.lab.plant.effects.battery import BatterySpec, open_voltage
from heli_twin.lab.plant.effects.cog_offset import CogOffset
from heli_twin.lab.plant.effects.ground_effect import GroundEffect
from heli_twin.lab.plant.effects.hub_drag import HubDrag
from heli_twin.lab.plant.effects.payload import Payload
from heli_twin.lab.plant.effects.rotor_speed import RotorSpeed
from heli_twin.lab.plant.effects.servo import Servo
from heli_twin.lab.plant.effects.spool_up import SpoolUp
from heli_twin.lab.plant.effects.stabiliser_bar import StabiliserBar
from heli_twin.lab.plant.effects.thrust_yaw_coupling import ThrustYawCoupling
from heli_twin.lab.plant.mujoco import MuJoCo

FAMILY = members("heli_twin.lab.plant.effects")
MS = 1_000_000
SECOND = 1000 * MS
NOMINAL = MuJoCo()
HOVER = np.array(NOMINAL.trim)
STIFFNESS = NOMINAL.inertia_yy * NOMINAL.attitude_frequency**2


def at(height=1.0, **states):
    names = ("x", "y", "z", "yaw", "vx", "vy", "vz", "yaw_rate")
    return np.array([float({"z": height, **states}.get(name, 0.0)) for name in names])


def twin(*effects, x=None, **fields):
    return MuJoCo(effects=effects, **fields).start(at() if x is None else x)


def trim_of(plant):
    return plant.truth().actuators


def wobbly(n, seed=0):
    """Inputs (n, 4) that excite every axis."""
    t = 0.02 * np.arange(n)
    phase = np.random.default_rng(seed).uniform(0, 6, 4)
    return HOVER + np.array([0.3, 0.3, 0.1, 0.1]) * np.sin(np.outer(t, [5.0, 7.0, 6.0, 9.0]) + phase)


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize("kind", FAMILY)
class TestEveryEffect:
    def test_is_a_value(self, kind):
        spec = FAMILY[kind]()
        assert spec.kind == kind
        assert spec == FAMILY[kind]()
        assert hash(spec) == hash(FAMILY[kind]())
        with pytest.raises(FrozenInstanceError):
            spec.kind = "other"

    def test_is_off_unless_asked_for_and_survives_its_text(self, kind):
        assert MuJoCo().effects == ()
        on = load("lab", [f"plant.effects.{kind}=on"])
        assert FAMILY[kind]() in on.plant.effects
        assert from_json(canonical_json(on)) == on

    def test_leaves_hover_an_equilibrium(self, kind):
        """Its trim holds the helicopter still: for half a second even a battery hardly sags."""
        plant = twin(FAMILY[kind](), x=at(1.0, yaw=0.6))
        plant.advance(500 * MS, trim_of(plant), STILL_AIR)
        # A full battery loses 1e-3 of its charge, hence 6e-4 of the thrust, in half a second: 0.8 mm.
        # A string stretches by a micrometre. Others: rounding.
        np.testing.assert_allclose(
            physical_state(plant.truth()), at(1.0, yaw=0.6), atol={"battery": 2e-3, "payload": 1e-5}.get(kind, 1e-9)
        )

    def test_changes_a_flight_and_the_same_way_each_time(self, kind):
        plain, first, again = (
            MuJoCo(effects=effects).start(at(0.046)) for effects in ((), (FAMILY[kind](),), (FAMILY[kind](),))
        )
        throttle = np.array([0, 0, 0.3, 0])
        for k, u in enumerate(wobbly(50) + throttle, 1):
            for plant in (plain, first, again):
                plant.advance(k * 20 * MS, u, Air(np.array([0.5, -0.3, 0.0]), np.zeros(3)))
        assert same(first.truth(), again.truth())
        assert not np.array_equal(plain.truth().position, first.truth().position)
        assert np.isfinite(physical_state(first.truth())).all()

    @pytest.mark.parametrize("seed", range(3))
    def test_a_flight_in_pieces_is_the_flight_at_once(self, kind, seed):
        air = Air(np.array([0.4, -0.3, 0.2]), np.array([0.1, 0.05, 0.0]), 0.97)
        once, pieces = (twin(FAMILY[kind](), x=at(0.15, vx=0.3, yaw_rate=4.0)) for _ in range(2))
        rng = np.random.default_rng(seed)
        for k, u in enumerate(wobbly(4, seed), 1):
            until = k * 73 * MS
            once.advance(until, u, air)
            for ms in [*sorted(rng.integers(0, 73, 4)), 73]:
                pieces.advance((k - 1) * 73 * MS + int(ms) * MS, u, air)
        assert same(once.truth(), pieces.truth())

    def test_is_in_the_description(self, kind):
        assert twin(FAMILY[kind]()).description().startswith("<mujoco")


def test_all_effects_together_hover():
    plant = twin(*(spec() for spec in FAMILY.values()))
    plant.advance(500 * MS, trim_of(plant), STILL_AIR)
    np.testing.assert_allclose(physical_state(plant.truth()), at(), atol=2e-3)


# --- hub drag -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("axis", "inertia", "drag"), [(0, 3.9e-5, 0.014), (1, 2.8e-5, 0.0112)])
def test_a_gust_tilts_by_drag_times_hub_height(axis, inertia, drag):
    wind = np.zeros(3)
    wind[axis] = 1.0
    plant = twin(HubDrag(height=0.05, flapping=1e-4))
    plant.advance(MS, HOVER, Air(wind, np.zeros(3)))
    # After one step of 1 ms the rate is moment over inertia; the engine treats the damping 2 zeta w I implicitly.
    inertia += 1e-3 * 2 * 0.5 * 14.0 * np.sqrt(3.9e-5 * inertia)
    rate = plant.truth().angular_velocity[1 - axis] * (1 if axis == 0 else -1)
    assert rate == pytest.approx(1e-3 * (0.05 * drag + 1e-4) / inertia, rel=1e-6)
    # The couple is no force: the gust pushes as without it.
    assert plant.truth().velocity[axis] == pytest.approx(1e-3 * drag / 0.028, rel=1e-6)


def test_the_speed_per_stick_falls_by_the_hubs_moment():
    plant = twin(HubDrag(), x=at(50.0), drag_z=0.5)
    plant.advance(20 * SECOND, HOVER + np.array([0.05, 0, 0, 0]), STILL_AIR)
    paper = 2.0 * 0.05 / 0.5
    expected = paper / (1 + NOMINAL.mass * GRAVITY * 0.041 / STIFFNESS)
    # Tilt of half a degree: its square, and the slow sinking, are below one in a thousand.
    assert plant.truth().velocity[0] == pytest.approx(expected, rel=2e-3)


# --- heave damping --------------------------------------------------------------------------------------------------


def test_climb_settles_where_heave_damping_balances_the_thrust():
    plant = twin(drag_z=0.042)
    plant.advance(10 * SECOND, HOVER + np.array([0, 0, 0.05, 0]), STILL_AIR)
    # exp(-1.5 * 10) of it is left.
    assert plant.truth().velocity[2] == pytest.approx(0.05 * 0.504 / 0.042, rel=1e-5)
    lifted = twin(drag_z=0.042)
    lifted.advance(10 * SECOND, HOVER, Air(np.array([0, 0, 0.3]), np.zeros(3)))
    assert lifted.truth().velocity[2] == pytest.approx(0.3, rel=1e-5)


# --- thrust-yaw coupling --------------------------------------------------------------------------------------------


def test_more_thrust_turns_the_nose_to_port():
    plant = twin(ThrustYawCoupling(lever=0.002))
    plant.advance(4 * SECOND, HOVER + np.array([0, 0, 0.1, 0]), STILL_AIR)
    # exp(-5 * 4) of it is left.
    assert plant.truth().yaw_rate == pytest.approx(0.002 * 0.1 * 0.504 / 1.35e-4, rel=1e-6)


# --- battery --------------------------------------------------------------------------------------------------------


def flown_empty(spec, seconds, throttle=HOVER[2]):
    plant = twin(spec, x=at(200.0))
    readings = []
    for k in range(round(10 * seconds)):
        plant.advance((k + 1) * SECOND // 10, np.array([0, 0, throttle, 0]), STILL_AIR)
        readings.append(plant.battery())
    return readings, plant


def test_the_voltage_of_a_cell_without_load_falls_with_its_charge():
    # A lithium-polymer cell, by tenths.
    volts = [open_voltage(charge) for charge in np.arange(11) / 10]
    assert volts == pytest.approx([3.00, 3.60, 3.69, 3.74, 3.77, 3.80, 3.84, 3.90, 3.97, 4.06, 4.20], abs=1e-12)
    assert open_voltage(0.05) == pytest.approx(3.45, abs=1e-12)


def test_the_current_grows_with_the_power_three_halves_of_the_thrust():
    """Momentum theory: power is thrust times induced speed, which grows with its root. A payload asks for more."""
    spec = BatterySpec()
    loaded = MuJoCo(effects=(spec, Payload(mass=0.007))).start(at()).battery()
    assert loaded.current == pytest.approx(spec.idle_current + spec.hover_current * (35 / 28) ** 1.5, rel=1e-12)


def test_a_full_battery_gives_the_nominal_thrust_and_a_low_one_needs_more_throttle():
    assert trim_of(twin(BatterySpec()))[2] == pytest.approx(HOVER[2], rel=1e-12)
    low = BatterySpec(charge=0.3)
    voltage, nominal = open_voltage(0.3) - 0.28 * 0.88, open_voltage(1.0) - 0.28 * 0.88
    assert trim_of(twin(low))[2] == pytest.approx(HOVER[2] * (nominal / voltage) ** 1.6, rel=1e-9)


def test_charge_is_the_current_over_time():
    readings, _ = flown_empty(BatterySpec(capacity=0.01), 3.0)
    drawn = np.diff([b.charge for b in readings])
    current = np.array([b.current for b in readings])
    # Readings are every tenth period; the current changes by less than a percent between two.
    np.testing.assert_allclose(-drawn, 0.5 * (current[1:] + current[:-1]) * 0.1 / 36.0, rtol=0.01)
    assert all(isinstance(b, Battery) for b in readings)


def test_voltage_is_that_of_the_cell_less_the_drop_under_load():
    readings, _ = flown_empty(BatterySpec(capacity=0.01), 3.0)
    for b in readings:
        # The charge is that after the period, the voltage that at its begin: 10 ms of 1 A at 0.01 A h, 3e-4 of it.
        assert b.voltage == pytest.approx(open_voltage(b.charge) - 0.28 * b.current, abs=2e-3)


def test_a_cell_flies_as_long_as_the_maker_says():
    spec = BatterySpec()
    minutes = spec.capacity / (spec.idle_current + spec.hover_current) * 60
    assert 7.0 < minutes < 8.0


def test_the_cut_off_takes_its_share_of_the_thrust():
    throttles = [MuJoCo(effects=(BatterySpec(cut_off=v),)).start(at()).truth().actuators[2] for v in (0.0, 10.0)]
    assert throttles[1] == pytest.approx(throttles[0] / 0.7, rel=1e-12)


def test_the_cut_off_is_for_good():
    readings, plant = flown_empty(BatterySpec(charge=0.02, capacity=0.02, cut_off=3.1), 3.0)
    assert readings[-1].voltage > 0
    # Thrust is lost, so that the load falls and the voltage recovers above the cut-off: it stays cut.
    assert plant.truth().velocity[2] < -5.0


def test_a_plant_without_a_battery_has_none():
    assert NOMINAL.start(at()).battery() is None


# --- ground effect --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("height", [0.045, 0.1, 0.3, 1.0])
def test_ground_effect_is_cheeseman_and_bennett_s(height):
    factor = 1 / (1 - (0.095 / (4 * (height + 0.028))) ** 2)
    assert trim_of(twin(GroundEffect(), x=at(height)))[2] == pytest.approx(HOVER[2] / factor, rel=1e-9)


def test_ground_effect_is_capped():
    # Half a radius above the floor: 4 / 3, and no more below.
    assert GroundEffect(hub=0.0).share(0.0) == GroundEffect(hub=0.0).share(0.0475) == pytest.approx(0.25)


def test_sideways_damping_is_lost_near_the_floor():
    slow = []
    for effects in ((), (GroundEffect(damping_loss=3.0),)):
        plant = twin(*effects, x=at(0.06, vx=0.1))
        plant.advance(5 * MS, trim_of(plant), STILL_AIR)
        slow.append(0.1 - plant.truth().velocity[0])
    share = GroundEffect().share(0.06)
    assert slow[1] / slow[0] == pytest.approx(1 - 3.0 * share, rel=0.01)


def test_no_damping_turns_into_a_push_near_the_floor():
    near = GroundEffect(damping_loss=10.0, hub=0.0)
    assert 10.0 * near.share(0.06) > 1.0
    plant = twin(near, x=at(0.06, vx=0.1))
    plant.advance(5 * MS, trim_of(plant), STILL_AIR)
    assert plant.truth().velocity[0] == pytest.approx(0.1, abs=1e-7)


# --- servo ----------------------------------------------------------------------------------------------------------

AT_ONCE = {"servo_lag": 0.0, "input_delay": 0.0}


def reached(spec, sticks, period=20):
    """Where the swashplate is after each period of ms, for pitch inputs."""
    plant, out = MuJoCo(effects=(spec,), **AT_ONCE).start(at(100.0)), []
    for k, stick in enumerate(sticks, 1):
        plant.advance(k * period * MS, np.array([stick, 0.0, HOVER[2], 0.0]), STILL_AIR)
        out.append(plant.truth().actuators[0])
    return np.array(out)


def test_a_servo_moves_no_faster_than_it_can():
    path = reached(Servo(deadband=0.0, slew=2.5, backlash=0.0), [1.0] * 30)
    # 2.5 a second: 0.05 every 20 ms, from the first moment on.
    np.testing.assert_allclose(path, np.minimum(0.05 * np.arange(1, 31), 1.0), atol=1e-12)


def test_a_small_input_acts_at_once():
    assert reached(Servo(deadband=0.0, slew=2.5, backlash=0.0), [0.02], period=1)[0] == pytest.approx(0.02, abs=1e-12)


def test_backlash_holds_until_the_play_is_used_up():
    sticks = [0.2, 0.19, 0.15, 0.14, 0.0, 0.04]
    path = reached(Servo(deadband=0.0, slew=1e4, backlash=0.06), sticks)
    np.testing.assert_allclose(path, [0.17, 0.17, 0.17, 0.17, 0.03, 0.03], atol=1e-12)


def test_a_servo_ignores_a_change_within_its_deadband():
    path = reached(Servo(deadband=0.02, slew=1e4, backlash=0.0), [0.1, 0.115, 0.125, 0.11, 0.1])
    np.testing.assert_allclose(path, [0.1, 0.1, 0.125, 0.125, 0.1], atol=1e-12)


def test_the_servo_s_lag_is_the_plant_s():
    plant = MuJoCo(effects=(Servo(deadband=0.0, slew=1e4, backlash=0.0),)).start(at(100.0))
    plain = NOMINAL.start(at(100.0))
    for p in (plant, plain):
        p.advance(50 * MS, HOVER + np.array([0.3, -0.2, 0.1, 0.1]), STILL_AIR)
    assert same(plant.truth(), plain.truth())


# --- centre of gravity and rotor speed ------------------------------------------------------------------------------


def test_a_centre_of_gravity_beside_the_mast_needs_trim():
    trim = trim_of(twin(CogOffset(x=0.001, y=-0.0005)))
    moment = NOMINAL.mass * GRAVITY * 0.001
    assert trim[0] == pytest.approx(-moment / (STIFFNESS * NOMINAL.pitch_gain), rel=1e-6)
    assert trim[1] == pytest.approx(0.5 * moment / (STIFFNESS * NOMINAL.roll_gain), rel=1e-6)
    # Untrimmed it flies off to where the weight is.
    plant = twin(CogOffset(x=0.001))
    plant.advance(SECOND, HOVER, STILL_AIR)
    assert plant.truth().velocity[0] > 0.1


def test_rotors_turn_within_their_limits():
    plant = twin(RotorSpeed(least=0.2, most=0.7))
    for u, limit in ((1.0, 0.7), (0.0, 0.2)):
        plant.advance(plant.truth().stamp + 2 * SECOND, np.array([0, 0, u, 0]), STILL_AIR)
        # exp(-2 / 0.06) of the way is left.
        assert plant.truth().actuators[2] == pytest.approx(limit, abs=1e-9)


def test_without_effects_nothing_changes():
    """The twin as it was: the same canonical text, hence the same digests."""
    assert "effects" not in canonical_json(load("ideal", ["plant.kind=mujoco"]))
    assert replace(NOMINAL, effects=()) == NOMINAL


def test_two_effects_of_one_kind_are_refused():
    with pytest.raises(ValueError, match="two of the kind 'hub_drag'"):
        MuJoCo(effects=(HubDrag(), HubDrag(height=0.03)))


# --- payload ----------------------------------------------------------------------------------------------------------


def heights(spec, seconds=3.0):
    """Height every 100 ms of a flight at the throttle it begins with."""
    plant, out = twin(spec, x=at(5.0)), []
    u = trim_of(plant)
    for k in range(1, round(10 * seconds) + 1):
        plant.advance(k * 100 * MS, u, STILL_AIR)
        out.append(plant.truth().position[2])
    return np.array(out)


@pytest.mark.parametrize("string", [0.0, 0.3])
def test_a_payload_is_carried_from_pick_up_to_drop(string):
    carried = heights(Payload(string=string))
    # The string stretches by its softness, below a millimetre, and swings no further.
    np.testing.assert_allclose(carried, 5.0, atol=2e-3)
    dropped = heights(Payload(string=string, drop=1.0))
    np.testing.assert_allclose(dropped[:10], 5.0, atol=2e-3)
    # Then thrust is too much for what is left: 2 / 28 of g.
    assert dropped[-1] - 5.0 == pytest.approx(0.5 * GRAVITY * 2 / 28 * 2.0**2, rel=0.006)
    taken = heights(Payload(string=string, pick_up=1.0))
    assert taken[9] == pytest.approx(5.0, abs=1e-9)
    assert taken[-1] - 5.0 == pytest.approx(-0.5 * GRAVITY * 2 / 30 * 2.0**2, rel=0.02)


def test_a_fixed_payload_moves_the_centre_of_gravity_and_adds_its_inertia():
    alone = twin(CogOffset(x=0.004))._model.body("fuselage")
    plant = twin(CogOffset(x=0.004), Payload(string=0.0, mass=0.007))
    plant.advance(20 * MS, trim_of(plant), STILL_AIR)
    loaded, m = plant._model.body("fuselage"), float(alone.mass[0])
    share = 0.007 / (m + 0.007)
    # The hook is between the skids, 1.5 mm above the floor when it stands: 43.5 mm below the mast's foot.
    np.testing.assert_allclose(loaded.ipos, [0.004 * (1.0 - share), 0.0, -0.0435 * share], atol=1e-15)
    # Parallel axes, with the reduced mass: 4 mm and 43.5 mm apart.
    x2, z2 = 0.004**2, 0.0435**2
    np.testing.assert_allclose(loaded.inertia - alone.inertia, m * share * np.array([z2, x2 + z2, x2]), rtol=1e-9)


def test_a_payload_swings_as_a_pendulum():
    plant = twin(Payload(mass=1e-4, string=0.5), x=at(20.0, vx=0.3))
    # The helicopter is 280 times heavier: let it stand still, and the payload swings under it.
    data = plant._data
    data.qvel[0] = 0.0
    swing = []
    for k in range(1, 301):
        plant.advance(k * 10 * MS, trim_of(plant), STILL_AIR)
        swing.append(data.qpos[-3] - data.qpos[0])
    crossings = np.flatnonzero(np.diff(np.sign(swing)) < 0)
    # 4 degrees of swing make it 0.1 % slower; crossings are read to 10 ms.
    assert np.diff(crossings)[0] * 0.01 == pytest.approx(2 * np.pi * np.sqrt(0.5 / GRAVITY), abs=0.02)


def test_a_dropped_payload_on_the_floor_is_not_the_helicopter_touching():
    plant = twin(Payload(drop=0.1))
    plant.advance(2 * SECOND, HOVER, STILL_AIR)
    assert plant._data.ncon > 0
    assert not plant.truth().touching


# --- stabiliser bar and spool-up --------------------------------------------------------------------------------------


def test_with_a_stabiliser_bar_a_held_stick_tilts_on():
    plant, pitch = twin(StabiliserBar(share=1.0, following_time=0.5), x=at(50.0)), []
    for k in (1, 2):
        plant.advance(k * SECOND, HOVER + np.array([0.1, 0, 0, 0]), STILL_AIR)
        pitch.append(2 * np.arcsin(plant.truth().quat_wxyz[2]))
    # Stick against spring and damper: t - b = gain s - 2 zeta / w t', and t' = b' = (t - b) / following_time.
    rate = NOMINAL.pitch_gain * 0.1 / (0.5 + 2 * 0.5 / 14.0)
    # The attitude's own transient, exp(-7 * 1), and the square of the tilt.
    assert pitch[1] - pitch[0] == pytest.approx(rate, rel=0.01)


def test_a_slow_bar_is_the_level_at_first():
    plain, barred = NOMINAL.start(at(50.0)), twin(StabiliserBar(share=1.0, following_time=20.0), x=at(50.0))
    for plant in (plain, barred):
        plant.advance(500 * MS, HOVER + np.array([0.1, 0.1, 0, 0]), STILL_AIR)
    # Half a second of 20.
    np.testing.assert_allclose(barred.truth().quat_wxyz[1:3], plain.truth().quat_wxyz[1:3], rtol=0.03)


def test_on_the_floor_the_rotors_stand_until_the_first_command():
    plant = twin(SpoolUp(), x=at(0.045))
    assert plant.truth().touching
    assert trim_of(plant)[2] == 0.0
    plant.advance(60 * MS, HOVER, STILL_AIR)
    # 58 ms after the delay of 2 ms, with a lag of 60 ms.
    assert trim_of(plant)[2] == pytest.approx(HOVER[2] * (1 - np.exp(-58 / 60)), rel=1e-9)
    assert trim_of(twin(SpoolUp(), x=at(1.0)))[2] == HOVER[2]


@pytest.mark.parametrize(("gap", "stands"), [(0.0009, True), (0.0011, False)])
def test_who_is_within_a_millimetre_of_the_floor_stands_on_it(gap, stands):
    # The skids reach down to 45 mm below the centre of gravity.
    assert twin(SpoolUp(), x=at(0.045 + gap)).truth().touching == stands


def test_rotors_that_start_on_the_floor_have_balanced_torques_in_hover():
    plant = twin(SpoolUp(), ThrustYawCoupling(), x=at(0.045))
    lifting = HOVER * 1.05
    plant.advance(3 * SECOND, lifting, STILL_AIR)
    assert plant.truth().position[2] > 1.0
    # 5 % more thrust than in hover: lever 0.05 m g over the yaw damping.
    assert plant.truth().yaw_rate == pytest.approx(0.0008 * 0.05 * NOMINAL.mass * GRAVITY / 1.35e-4, rel=1e-3)


def test_a_cell_that_cannot_feed_hovering_gives_no_thrust():
    plant = twin(BatterySpec(resistance=2.0, hover_current=2.0, idle_current=2.0), x=at(5.0))
    plant.advance(500 * MS, HOVER, STILL_AIR)
    assert plant.truth().velocity[2] < -2.0
