import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.descent import Descent, descend, hold
from controllers.model import GRAVITY, Model
from controllers.signals import Command, Estimate, QpReport
from controllers.supervisors import LandsOnPlan
from controllers.supervisors.off import NoSupervisor
from controllers.supervisors.safety import Safety

MODEL, PERIOD, MS = Model(), 0.02, 1_000_000
HOVER = np.array(MODEL.u_hover)
STEPS = 10


class Station:
    """A supervisor with made-up estimates: what it orders, step by step."""

    def __init__(self, spec=None, *, height=1.0, plan_height=None):
        self.spec = spec or Safety()
        self.supervisor = self.spec.start(MODEL, PERIOD)
        self.x = np.array([0.1, -0.2, height, 0.3, 0.4, 0.0, 0.0, 0.0])
        self.plan_height = plan_height or (lambda t: height)
        self.now, self.seen, self.status = 0, 0, "solved"
        self.orders, self.events, self.commands = [], [], []

    def fly(self, seconds, *, poses=True):
        for _ in range(round(seconds / PERIOD)):
            self.seen = self.now if poses else self.seen
            stamp = self.now + 22 * MS
            estimate = Estimate(stamp, self.x, np.zeros(4), np.zeros((4, 3)), self.seen, 0)
            plan = hold(MODEL, stamp, STEPS, np.array([0, 0, self.plan_height(1e-9 * self.now), 0]))
            order = self.supervisor.order(self.now, estimate, plan)
            command = order.command or Command(self.now, HOVER, qp=QpReport(self.status, 0, 0, 0.0, 0.0))
            self.supervisor.sent(command)
            self.orders.append(order)
            self.commands.append(command.u)
            if order.event:
                self.events.append((order.event.phase, 1e-9 * self.now))
            self.now += 20 * MS
        return self

    @property
    def phase(self):
        return self.supervisor.phase


def test_without_a_supervisor_the_plan_is_flown():
    station = Station(NoSupervisor()).fly(0.1).fly(5.0, poses=False)
    assert all(order.command is None and order.reference.x[0, 2] == 1.0 for order in station.orders)
    assert not station.events


@pytest.mark.parametrize(
    ("unseen", "phase"),
    [
        (0.06, "flying"),
        (0.2, "coasting"),
        (0.46, "coasting"),
        (0.6, "levelling"),
        (0.72, "levelling"),
        (0.8, "landing"),
    ],
)
def test_the_phase_follows_the_age_of_the_poses(unseen, phase):
    station = Station().fly(1.0).fly(unseen, poses=False)
    assert station.phase == phase
    station.fly(0.1)
    assert station.phase == ("landing" if phase == "landing" else "flying")


def test_times_are_fields():
    spec = Safety(coast_after=0.2, level_after=2.0, land_after=3.0)
    station = Station(spec).fly(1.0).fly(3.2, poses=False)
    # The last pose is of 0.98 s; a step later than the time is over.
    assert station.events == [
        ("flying", 0.0),
        ("coasting", pytest.approx(1.2)),
        ("levelling", pytest.approx(3.0)),
        ("landing", pytest.approx(4.0)),
    ]


def test_levelling_holds_the_place_where_it_began_and_landing_goes_straight_down():
    station = Station().fly(1.0).fly(0.7, poses=False)
    place = station.x[:4].copy()
    np.testing.assert_array_equal(station.orders[-1].reference.x[:, :4], np.tile(place, (STEPS + 1, 1)))
    station.x = station.x + 0.05
    station.fly(1.0, poses=False)
    reference = station.orders[-1].reference.x
    np.testing.assert_array_equal(reference[:, [0, 1, 3]], np.tile(place[[0, 1, 3]], (STEPS + 1, 1)))
    assert reference[0, 2] < 0.5


def test_in_a_room_it_stops_and_lands_along_the_plan():
    """The plan is at x = y = 0, where the helicopter is not; in height it comes down from where it is."""
    station = Station(plan_height=lambda t: 1.2)
    station.supervisor.lands_on_plan = True
    assert isinstance(station.supervisor, LandsOnPlan)
    station.fly(1.0).fly(0.68, poses=False)
    assert station.phase == "levelling"
    levelling = station.orders[-1].reference
    np.testing.assert_array_equal(levelling.x[:, :4], np.tile([0.0, 0.0, 1.0, 0.0], (STEPS + 1, 1)))
    assert not levelling.x[:, 6].any()
    assert (levelling.u == HOVER).all()
    station.fly(0.4, poses=False)
    assert station.phase == "landing"
    landing = [order.reference.x for order in station.orders[-15:]]
    assert all(not x[:, [0, 1, 3]].any() for x in landing)
    heights = [x[0, 2] for x in landing]
    assert (np.diff(heights) < 0.0).all()
    assert heights[0] < 1.0
    assert levelling.flat is None


def test_blind_on_the_floor_the_motors_stop_and_stay_so():
    station = Station().fly(1.0).fly(5.0, poses=False)
    assert station.phase == "landed"
    assert not station.commands[-1].any()
    station.fly(2.0)
    assert station.phase == "landed"


def test_seen_on_the_floor_the_motors_stop_and_seen_above_it_they_do_not():
    station = Station().fly(1.0).fly(1.2, poses=False).fly(6.0)
    assert station.phase == "landing"
    station.x[2] = 0.05
    assert station.fly(0.2).phase == "landed"


@pytest.mark.parametrize(
    ("above", "speed", "phase"),
    [(0.019, 0.0, "landed"), (0.021, 0.0, "landing"), (0.0, -0.149, "landed"), (0.0, -0.151, "landing")],
)
def test_it_stands_within_two_centimetres_of_the_floor_and_below_15_cm_s(above, speed, phase):
    station = Station().fly(1.0).fly(1.2, poses=False)
    station.x[2], station.x[6] = 0.045 + above, speed
    assert station.fly(0.2).phase == phase


def test_without_a_solver_it_lands_level_by_its_own_thrust():
    station = Station().fly(1.0)
    station.status = "shifted_plan"
    assert station.fly(0.4).phase == "flying"
    assert station.fly(0.2).phase == "landing"
    station.fly(0.3)
    assert all(order.command is not None for order in station.orders[-15:])
    assert not np.array(station.commands)[-15:, [0, 1, 3]].any()
    # It is above its way down, for here it does not sink.
    assert station.commands[-1][2] < HOVER[2]


def test_with_a_battery_that_is_low_it_lands():
    station = Station().fly(1.0)
    station.supervisor.battery(3.31)
    assert station.fly(1.0).phase == "flying"
    station.supervisor.battery(3.29)
    assert station.fly(0.04).phase == "landing"


@pytest.mark.parametrize(("axis", "value"), [(0, 2.3), (1, -2.3), (2, 2.4)])
def test_near_the_edge_of_the_room_it_lands(axis, value):
    station = Station().fly(1.0)
    station.x[axis] = value
    assert station.fly(0.04).phase == "landing"


def test_a_plan_that_starts_on_the_floor_starts_the_motors_first():
    station = Station(height=0.045, plan_height=lambda t: 0.045 if t < 1.0 else 0.1)
    station.fly(1.0)
    thrust = np.array(station.commands)[:, 2]
    assert station.phase == "ready"
    assert thrust[0] < 0.1
    assert (np.diff(thrust) >= 0).all()
    assert thrust[-1] == pytest.approx(0.8 * HOVER[2])
    station.fly(0.1)
    assert station.phase == "flying"


def test_nobody_starts_blind():
    station = Station(height=0.045, plan_height=lambda t: 0.045 if t < 1.0 else 0.1)
    station.fly(0.5).fly(2.0, poses=False)
    assert station.phase == "landed"
    assert not station.commands[-1].any()


def test_a_plan_that_comes_down_ends_with_the_motors_off():
    station = Station(plan_height=lambda t: 1.0 if t < 1.0 else 0.045)
    station.fly(1.5)
    assert station.phase == "flying"
    station.x[2] = 0.047
    assert station.fly(1.0).phase == "landed"
    assert not station.commands[-1].any()


def test_without_any_pose_it_sinks_open_loop():
    supervisor, thrust = Safety().start(MODEL, PERIOD), []
    for k in range(300):
        order = supervisor.order(20 * k * MS, None, hold(MODEL, 20 * k * MS, STEPS, np.array([0, 0, 1.0, 0])))
        command = order.command or Command(20 * k * MS, HOVER, qp=QpReport("safe_hover", 0, 0, 0.0, 0.0))
        supervisor.sent(command)
        thrust.append(command.u[2])
    assert supervisor.phase == "landed"
    # Thrust and weight make it sink by the height it believes to have, within a step.
    until = next(k for k in range(300) if thrust[k] < 0.2)
    speed = PERIOD * np.cumsum(MODEL.b_z * np.array(thrust[: until - 20 - round(Safety().press / PERIOD)]) - GRAVITY)
    assert PERIOD * speed.sum() == pytest.approx(-0.955, abs=0.15)


@given(st.floats(0.1, 2.4), st.floats(-1.0, 1.0), st.floats(0.2, 2.0), st.floats(0.1, 0.5))
def test_a_descent_is_brisk_and_meets_the_floor_slowly(height, speed, sink, touch):
    descent = Descent(sink, min(touch, sink), 0.05, 5.0, -0.005, 0.045)
    heights, speeds = [height], [speed]
    while heights[-1] > descent.bottom and len(heights) < 2000:
        h, v = descent.step(heights[-1], speeds[-1], PERIOD)
        assert abs(v - speeds[-1]) <= 5.0 * PERIOD + 1e-9
        heights.append(h)
        speeds.append(v)
        if h <= descent.bottom:
            break
    assert heights[-1] == descent.bottom
    assert min(speeds) >= -max(sink, -min(speed, 0.0)) - 1e-9
    slow = [v for h, v in zip(heights, speeds, strict=True) if h < 0.045]
    # A start that is too low and too fast to slow down is none of its doing: 5 m/s^2 from 1 m/s take 0.1 m.
    if height > 0.3:
        assert min(slow) >= -min(touch, sink) - 5.0 * PERIOD


def test_a_descent_brakes_at_its_acceleration_down_to_its_touch_speed():
    descent = Descent(10.0, 0.4, 0.05, 5.0, -0.005, 0.045)
    # v^2 = 0.4^2 + 2 * 5 * h at h above where it is slow.
    for above in (0.0, 0.3, 1.0):
        speed = -np.sqrt(0.16 + 10.0 * above)
        assert descent.step(0.095 + above, speed, PERIOD)[1] == pytest.approx(speed, rel=1e-12)


def test_a_descending_reference_satisfies_the_dynamics_in_height():
    descent = Descent(1.2, 0.4, 0.05, 5.0, -0.005, 0.045)
    reference = descend(hold(MODEL, 0, 60, np.array([0, 0, 0.8, 0])), MODEL, descent, -0.2, PERIOD)
    x, u = reference.x, reference.u
    moving = x[1:, 2] > descent.bottom
    np.testing.assert_allclose(np.diff(x[:, 6])[moving], PERIOD * (MODEL.b_z * u[moving, 2] - GRAVITY), atol=1e-12)
    np.testing.assert_allclose(np.diff(x[:, 2])[moving], PERIOD * x[1:, 6][moving], atol=1e-12)


@pytest.mark.parametrize("damping", [0.0, 1.5])
def test_a_blind_descent_with_the_heave_damping_that_is_believed_ends_at_the_floor_at_its_touch_speed(damping):
    spec = Safety(heave_damping=damping)
    station = Station(spec).fly(1.0).fly(3.0, poses=False)
    height, speed = 1.0, 0.0
    for order in station.orders:
        if order.thrust is not None:
            speed += PERIOD * (MODEL.b_z * order.thrust - GRAVITY - damping * speed)
            height += PERIOD * speed
            if order.reference.x[0, 2] <= spec.floor:
                break
    # Two steps of Euler's method at the sink speed.
    assert height == pytest.approx(spec.floor, abs=2 * PERIOD * spec.sink_speed)
    assert -speed == pytest.approx(spec.touch_speed, abs=0.15)


def test_with_poses_the_descent_is_slow_and_blind_it_is_fast():
    for poses, fastest in ((True, Safety().seen_sink_speed), (False, Safety().sink_speed)):
        station = Station().fly(1.0)
        station.supervisor.battery(3.0)
        station.fly(1.0, poses=poses)
        sinking = [-order.reference.x[0, 6] for order in station.orders if order.reference is not None]
        assert max(sinking) == pytest.approx(fastest, abs=1e-9)


def test_a_helicopter_that_lingers_above_the_floor_is_taken_down_without_a_warning():
    station = Station(plan_height=lambda t: 1.0 if t < 1.0 else 0.045)
    station.x[2] = 0.08
    station.fly(1.0 + Safety().linger + 0.1)
    assert station.phase == "landing"
    assert [order.event.severity for order in station.orders if order.event][-1] == "info"
