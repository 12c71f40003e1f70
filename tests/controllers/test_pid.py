from dataclasses import replace
from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.flatness import feed_forward, state
from controllers.laws import ControlLaw
from controllers.laws.pid import Pid
from controllers.model import Model, advance
from controllers.signals import Estimate, Reference
from controllers.trajectories.circle import Circle
from controllers.trajectories.hover import Hover
from controllers.trajectories.pirouette import Pirouette

MODEL = Model()
PID = Pid()
HOVER = np.array(MODEL.u_hover)
REST = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])

states = st.tuples(*[st.floats(-100, 100)] * 8).map(np.array)


def moved(*by):
    """The state at rest, moved by the first of x y z yaw, vx vy vz and the yaw rate."""
    x = REST.copy()
    x[: len(by)] += by
    return x


def estimate(x):
    return Estimate(0, np.asarray(x, dtype=float), np.zeros(4), np.zeros((4, 3)), 0, 0)


def reference(x=REST, u=HOVER):
    return Reference(0, np.array([x, x]), np.array([u]))


def command(x, law=PID, plan=None):
    return law.start().step(0, estimate(x), plan or reference()).u


def fly(law, trajectory, seconds, model=MODEL, push=(0.0, 0.0, 0.0, 0.0), start=None):
    """Closed loop on the paper's model, no noise and no delay; the errors (n, 4) at the control steps."""
    t = law.period * np.arange(round(seconds / law.period) + 2)
    flat = trajectory.flat(t)
    x_ref, u_ref = state(flat), feed_forward(law.model, flat)
    controller, x, errors = law.start(), tuple((x_ref[0] if start is None else start).tolist()), []
    for k in range(len(t) - 1):
        errors.append(np.array(x[:4]) - x_ref[k, :4])
        u = controller.step(0, estimate(x), Reference(0, x_ref[k : k + 2], u_ref[k : k + 1])).u
        x = advance(model, x, tuple(u.tolist()), law.period, push)
    return np.array(errors)


def test_it_is_a_control_law():
    law: ControlLaw = PID
    assert (law.period, law.steps, law.model) == (0.02, 1, MODEL)


@pytest.mark.parametrize("kind", ["none", "flat"])
def test_hover_is_an_equilibrium(kind):
    np.testing.assert_array_equal(command(REST, replace(PID, feed_forward=kind)), HOVER)


@pytest.mark.parametrize("axis", range(4))
def test_each_axis_pushes_back_and_leaves_the_others_alone(axis):
    for offset in (-0.01, 0.01):
        x = REST.copy()
        x[axis] += offset
        u = command(x) - HOVER
        assert u[axis] * offset < 0.0
        np.testing.assert_array_equal(np.delete(u, axis), 0.0)
        speed = REST.copy()
        speed[4 + axis] += offset
        assert (command(speed) - HOVER)[axis] * offset < 0.0


@given(st.floats(-10, 10), st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.sampled_from(["none", "flat"]))
def test_where_north_is_does_not_matter(angle, ahead, port, kind):
    law = replace(PID, feed_forward=kind)
    u = np.array([0.1, -0.05, 0.5, 0.02])
    x = moved(ahead, port, 0.1, 0.2, 0.3, -0.2, 0.1, 0.4)
    c, s = cos(angle), sin(angle)
    turned, turned_ref = x.copy(), REST.copy()
    turned[:2] = c * ahead - s * port, s * ahead + c * port
    turned[3] += angle
    turned_ref[3] += angle
    # Rounding in turning there and back, times a gain of 3.5.
    np.testing.assert_allclose(
        command(turned, law, reference(turned_ref, u)), command(x, law, reference(REST, u)), atol=1e-13
    )


@given(states, states, st.sampled_from(["none", "flat"]))
def test_the_command_keeps_the_limits(x, x_ref, kind):
    model = Model(u_x_max=0.3, u_z_min=0.2, u_z_max=0.7)
    controller = replace(PID, feed_forward=kind, model=model).start()
    for _ in range(5):
        u = controller.step(0, estimate(x), reference(x_ref, np.array([2.0, -2.0, 2.0, 2.0]))).u
        assert (u >= model.u_min).all()
        assert (u <= model.u_max).all()


@given(st.integers(-5, 5))
def test_whole_turns_do_not_matter(turns):
    x = moved(0.1, -0.1, 0.0, 0.3 + 2.0 * pi * turns)
    # The last digits of 10 pi, times a gain of 3.5.
    np.testing.assert_allclose(command(x), command(moved(0.1, -0.1, 0.0, 0.3)), atol=1e-13)


def test_feedback_only_sees_nothing_but_the_planned_point():
    x, moving = REST + 0.01, REST.copy()
    moving[4:] = 0.5
    np.testing.assert_array_equal(command(x), command(x, plan=reference(moving, np.full(4, 0.2))))


def test_with_feed_forward_a_flight_on_plan_gets_the_planned_input():
    flat = Circle().flat(np.array([7.0, 7.02]))
    x, u = state(flat), feed_forward(MODEL, flat)
    # Turning by no angle at all rounds nothing but the sum.
    np.testing.assert_allclose(
        command(x[0], replace(PID, feed_forward="flat"), Reference(0, x, u[:1])), u[0], atol=1e-15
    )


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_answered_by_a_level_hover(value):
    x = REST.copy()
    x[5] = value
    np.testing.assert_array_equal(command(x), HOVER)


def test_an_integral_stops_while_its_input_is_at_the_limit():
    controller = PID.start()
    far = reference(moved(10.0, -10.0, 10.0, 3.0))
    for _ in range(1000):
        controller.step(0, estimate(REST), far)
    # All four were at their limits from the first step on: nothing has been gathered.
    np.testing.assert_array_equal(controller.step(0, estimate(REST), reference()).u, HOVER)


def test_an_integral_at_the_limit_still_unwinds():
    # Far away, with little stick to come back: for seconds the error wants more than there is.
    law = replace(PID, model=Model(u_x_max=0.2))
    errors = fly(law, Hover(), 60.0, start=moved(1.0))
    # A step within the limits overshoots by a tenth; wound up, it would come past by a third.
    assert errors[:, 0].min() > -0.1
    assert np.abs(errors[-50:, 0]).max() < 1e-3


@pytest.mark.parametrize(
    ("model", "push"),
    [
        (MODEL, (0.1, 0.05, 0.0, 2.0)),
        (replace(MODEL, b_z=0.92 * MODEL.b_z), (0.0, 0.0, 0.0, 0.0)),
        (replace(MODEL, b_x=1.6, b_y=2.5, b_yaw=90.0), (0.1, -0.1, 0.3, 0.0)),
    ],
    ids=["push", "weak_thrust", "wrong_gains"],
)
def test_integrals_cancel_a_steady_push(model, push):
    errors = fly(PID, Hover(), 60.0, model, push)
    # The slowest integral fades with p / i = 5 s: exp(-11) of at most 0.1 m.
    np.testing.assert_allclose(errors[-100:], 0.0, atol=1e-5)


def test_the_integral_stays_in_the_room_while_the_helicopter_turns():
    law = replace(PID, feed_forward="flat")
    errors = fly(law, Pirouette(), 60.0, push=(0.1, 0.05, 0.0, 0.0))
    # What is left is that forward and sideward gains differ by a tenth, so that the push seems to turn: held
    # by the body instead, the integrals would lag by p / i = 5 s of a 4 s turn and leave the whole 3 cm.
    assert np.abs(errors[-500:, :2]).max() < 0.003


@pytest.mark.parametrize("axis", range(4))
def test_a_step_is_followed_without_hurry_or_ringing(axis):
    start = REST.copy()
    size = (0.3, 0.3, 0.2, 0.5)[axis]
    start[axis] -= size
    response = 1.0 + fly(PID, Hover(), 20.0, start=start)[:, axis] / size
    time = PID.period * np.arange(len(response))
    # 90 % within 1.5 s, at most 20 % too far, within 5 % after two integral times.
    assert time[np.argmax(response > 0.9)] < 1.5
    assert response.max() < 1.2
    np.testing.assert_allclose(response[time > 10.0], 1.0, atol=0.05)
    # Once across and back: not a second time.
    crossings = np.count_nonzero(np.diff(np.sign(response[np.abs(response - 1.0) > 0.005] - 1.0)))
    assert crossings <= 2


def test_feed_forward_takes_the_lag_out_of_a_circle():
    # A held input is late by half a period, 0.5 m/s * 10 ms.
    assert np.abs(fly(replace(PID, feed_forward="flat"), Circle(), 20.0)).max() < 0.01
    assert np.abs(fly(PID, Circle(), 20.0))[:, :2].max() > 0.2


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_integral_that_leaves_the_limit_may_change(side):
    """The push of the speed holds the stick at a limit, and the error leads away from it: it is gathered."""
    controller = PID.start()
    flying, wanted = moved(0.0, 0.0, 0.0, 0.0, side * 9.0), moved(side * 0.1)
    assert controller.step(0, estimate(flying), reference(wanted)).u[0] == -side * MODEL.u_x_max
    before = controller.step(0, estimate(REST), reference()).u[0]
    assert before - HOVER[0] == pytest.approx(PID.i_x * PID.period * side * 0.1, rel=1e-6)
