from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm, null_space, solve_discrete_are

from controllers import receding
from controllers.condensed_qp import Condenser
from controllers.flatness import feed_forward, state
from controllers.laws.ltv_mpc import LtvMpc, LtvMpcController
from controllers.ltv import Linearisation
from controllers.model import Model, advance
from controllers.proxqp import ProxQp
from controllers.signals import Estimate, QpReport, Reference
from controllers.trajectories.circle import Circle
from controllers.trajectories.hover import Hover
from controllers.trajectories.pirouette import Pirouette

PERIOD = 0.02
MODEL = Model()
SOLVER = 2e-4
"""Error that the solver leaves: residuals of 1e-5 in 76 gradients at a curvature of 2."""


def estimate(x):
    return Estimate(0, np.asarray(x, float), np.zeros(4), np.zeros((4, 3)), 0, 0)


def planned(trajectory, k, steps):
    flat = trajectory.flat(PERIOD * (k + np.arange(steps + 1)))
    return Reference(0, state(flat), feed_forward(MODEL, flat)[:-1])


def decided(controller, k, x, reference):
    """A command with its plan."""
    return controller.explain(controller.step(k, estimate(x), reference))


def flown(spec, trajectory, seconds, x=None, push=(0.0, 0.0, 0.0, 0.0)):
    """The states (n, 8) of the believed model under the controller, seen without error, and where they should be."""
    controller = spec.start()
    x = tuple(planned(trajectory, 0, 1).x[0] if x is None else x)
    path = [x]
    for k in range(round(seconds / PERIOD)):
        command = controller.step(k, estimate(x), planned(trajectory, k, spec.steps))
        x = advance(MODEL, x, tuple(command.u), PERIOD, push)
        path.append(x)
    return np.array(path), state(trajectory.flat(PERIOD * np.arange(len(path))))


@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-20, 20), st.sampled_from(["removed", "full"]))
@settings(max_examples=20)
def test_hover_is_an_equilibrium(x, y, yaw, coupling):
    spec = LtvMpc(coupling=coupling)
    place = Hover(x=x, y=y, yaw=yaw)
    command = decided(spec.start(), 0, planned(place, 0, 1).x[0], planned(place, 0, spec.steps))
    assert command.qp.status == "solved"
    np.testing.assert_allclose(command.u, MODEL.u_hover, rtol=0, atol=SOLVER)
    # The plan is to stay: errors of the inputs' size, for 0.4 s.
    np.testing.assert_allclose(command.plan.x[:, :8], np.tile([x, y, 1, yaw, 0, 0, 0, 0], (20, 1)), atol=10 * SOLVER)


class Transcription:
    """(10)-(26) as they are printed, with states and inputs as unknowns: no condensing, nothing of the controller's."""

    def __init__(self, spec, x, reference):
        n = spec.steps
        nominal = [x]
        for k in range(n):
            moved = np.array(advance(MODEL, tuple(nominal[k][:8]), tuple(reference.u[k]), PERIOD))
            off = [nominal[k][:2] - reference.x[k, :2], moved[:2] - reference.x[k + 1, :2]]
            nominal.append(np.append(moved, nominal[k][8:] + 0.5 * PERIOD * spec.k_i * sum(off)))
        E, e = np.zeros((10 * n, 14 * n)), np.zeros(10 * n)
        for k in range(n):
            AB = Linearisation(MODEL, spec.k_i, PERIOD, spec.coupling, "euler").jacobians(nominal[k][None])[0]
            A, B = self.discrete(AB[:, :10], AB[:, 10:], spec.discretisation)
            # (22): what the linear model is off at the nominal point.
            d = nominal[k + 1] - A @ nominal[k] - B @ reference.u[k]
            rows = slice(10 * k, 10 * k + 10)
            E[rows, rows], e[rows] = np.eye(10), d
            E[rows, 10 * n + 4 * k : 10 * n + 4 * k + 4] = -B
            if k:
                E[rows, 10 * k - 10 : 10 * k] = -A
            else:
                e[rows] += A @ nominal[0]
        self.E, self.e, self.n = E, e, n
        self.weight = np.concatenate([np.tile(spec.Q, n), np.tile(spec.R, n)])
        x_ref = np.concatenate([reference.x[1:], np.zeros((n, 2))], axis=1)
        self.goal = np.concatenate([x_ref.ravel(), reference.u.ravel()])
        free = np.full(10, np.inf)
        free[4:8] = MODEL.v_max
        self.high = np.concatenate([np.tile(free, n), np.tile(MODEL.u_max, n)])
        self.low = np.concatenate([-np.tile(free, n), np.tile(MODEL.u_min, n)])

    def discrete(self, A, B, method):
        if method == "euler":
            return np.eye(10) + PERIOD * A, PERIOD * B
        held = expm(PERIOD * np.block([[A, B], [np.zeros((4, 14))]]))
        return held[:10, :10], held[:10, 10:]

    def plan(self, minimiser):
        point, basis = np.linalg.lstsq(self.E, self.e)[0], null_space(self.E)
        free = minimiser(
            basis.T @ (self.weight[:, None] * basis),
            basis.T @ (self.weight * (point - self.goal)),
            np.vstack([basis, -basis]),
            np.concatenate([self.high - point, point - self.low]),
        )
        z = point + basis @ free
        return z[: 10 * self.n].reshape(-1, 10), z[10 * self.n :].reshape(-1, 4)


@pytest.mark.parametrize("coupling", ["removed", "full"])
@pytest.mark.parametrize("discretisation", ["euler", "exact"])
@pytest.mark.parametrize("seed", range(3))
def test_the_plan_is_the_minimiser_of_the_printed_problem(coupling, discretisation, seed, minimiser):
    rng = np.random.default_rng(seed)
    spec = LtvMpc(horizon=7, coupling=coupling, discretisation=discretisation, integral_zone=10.0)
    reference = planned(Circle(rate=1.5), 200, spec.steps)
    x = reference.x[0] + rng.uniform(-1, 1, 8) * [1, 1, 1, 1, 1, 1, 1, 10]
    command = decided(spec.start(), 0, x, reference)
    # The trapezoidal rule has the error begin at 0, one period before the flight.
    integral = 0.5 * PERIOD * spec.k_i * (x - reference.x[0])[:2]
    states, inputs = Transcription(spec, np.append(x, integral), reference).plan(minimiser)
    at_bound = np.minimum(inputs - MODEL.u_min, MODEL.u_max - inputs) < 1e-9
    assert at_bound.any()
    assert not at_bound.all()
    np.testing.assert_allclose(command.plan.u, inputs, rtol=0, atol=SOLVER)
    # An input that is off by this much, over 0.16 s.
    np.testing.assert_allclose(command.plan.x[1:], states, rtol=0, atol=3 * SOLVER)
    np.testing.assert_array_equal(command.u, command.plan.u[0])
    assert (command.plan.u >= MODEL.u_min).all()
    assert (command.plan.u <= MODEL.u_max).all()


@pytest.mark.parametrize("coupling", ["removed", "full"])
def test_one_problem_alone_has_the_answer_it_had_in_flight(coupling):
    """Not one digit depends on the problems solved before: what counts are the nominal inputs and the integrals."""
    spec, rng = LtvMpc(coupling=coupling), np.random.default_rng(0)
    flown = spec.start()
    flight = [
        (estimate([3, 3, 1, 1, 1, 1, 1, 1] * OFF + 0.1 * rng.standard_normal(8)), planned(Circle(), k, spec.steps))
        for k in range(12)
    ]
    commands = [flown.explain(flown.step(k, *inputs)) for k, inputs in enumerate(flight)]
    alone = spec.start()
    for inputs in flight[:-1]:
        alone.problem(*inputs)
    alone.linearise_along(commands[-1].plan.u_nominal)
    again = alone.explain(alone.step(11, *flight[-1]))
    np.testing.assert_array_equal(again.plan.u, commands[-1].plan.u)
    assert again.qp == commands[-1].qp
    assert again.qp.active_bounds > 0


def ask_proxqp_alone(monkeypatch):
    """Leave every problem to it, with or without active bounds."""
    monkeypatch.setattr(Condenser, "minimiser", lambda self, cost: np.full_like(cost.g, np.nan))


def test_without_active_bounds_proxqp_is_not_asked(monkeypatch):
    monkeypatch.setattr(receding, "ProxQp", None)
    spec = LtvMpc()
    command = decided(spec.start(), 0, [0.01, -0.01, 1.01, 0.01, 0, 0, 0, 0], planned(Hover(), 0, spec.steps))
    assert command.qp[:3] == ("solved", 0, 0)
    assert command.solve_ns > 0


NARROW = {
    "wide": {},
    "speeds": {"vx_max": 0.3, "vy_max": 0.25, "vz_max": 0.2, "yaw_rate_max": 1.5},
    "inputs": {"u_x_max": 0.1, "u_y_max": 0.15, "u_z_min": 0.5, "u_z_max": 0.6, "u_yaw_max": 0.02},
}


@pytest.mark.parametrize("coupling", ["removed", "full"])
@pytest.mark.parametrize("narrow", NARROW)
def test_where_no_bound_is_active_the_answer_is_that_of_proxqp(narrow, coupling, monkeypatch):
    """Each bound counts: inputs and velocities of all axes, both ways."""
    spec, rng = LtvMpc(coupling=coupling, model=Model(**NARROW[narrow])), np.random.default_rng(1)
    reference, free = planned(Hover(), 0, spec.steps), []
    starts = [rng.choice([0.02, 0.1, 0.4]) * rng.uniform(-1, 1, 8) + [0, 0, 1, 0, 0, 0, 0, 0] for _ in range(40)]
    answers = [decided(spec.start(), 0, x, reference) for x in starts]
    ask_proxqp_alone(monkeypatch)
    for x, answer in zip(starts, answers, strict=True):
        judge = decided(spec.start(), 0, x, reference)
        assert (answer.qp.status, answer.qp.active_bounds) == (judge.qp.status, judge.qp.active_bounds)
        np.testing.assert_allclose(answer.plan.u, judge.plan.u, rtol=0, atol=1e-6)
        assert answer.qp.objective == pytest.approx(judge.qp.objective, rel=1e-6, abs=1e-9)
        assert answer.qp.slack == pytest.approx(judge.qp.slack, abs=1e-6)
        free.append(answer.qp.active_bounds == 0)
    assert 3 < sum(free) < 37


class Failing:
    """A solver that gives up at the calls it is told to; one solver serves a model in one part."""

    def __init__(self, monkeypatch, fails):
        self._fails, self._calls = fails, 0
        monkeypatch.setattr(receding, "ProxQp", self._of_sample)
        ask_proxqp_alone(monkeypatch)

    def _of_sample(self, *sample):
        self._solver = ProxQp(*sample)
        return self

    def __call__(self, qp):
        self._calls += 1
        return None if self._fails(self._calls) else self._solver(qp)


def test_the_weights_are_the_paper_s():
    # Kunz, Huck, Summers, ECC 2013, (30) and the text below it.
    spec = LtvMpc()
    assert spec.Q == (50, 50, 5, 10, 3, 3, 1, 2, 15, 15)
    assert spec.R == (2, 2, 2, 2)
    assert (spec.period, spec.horizon, spec.k_i) == (0.02, 18, 2.0)


OFF = np.array([0.3, -0.2, 0.9, 0.4, 0.1, 0.2, 0.0, 0.5])


def commands(spec, count, x=OFF):
    controller = spec.start()
    reference = planned(Hover(), 0, spec.steps)
    return [decided(controller, k, x, reference) for k in range(count)]


def test_where_no_solution_is_found_the_last_plan_is_flown_and_then_a_safe_hover(monkeypatch):
    Failing(monkeypatch, lambda call: call > 1)
    spec = LtvMpc(horizon=4, coupling="full")
    first, *rest = commands(spec, 9)
    assert first.qp.status == "solved"
    assert np.ptp(first.plan.u[:, 3]) > 0.01
    # Five inputs were planned: four are left, and the last one is held once more.
    assert [c.qp.status for c in rest] == ["shifted_plan"] * 5 + ["safe_hover"] * 3
    np.testing.assert_array_equal([c.u for c in rest[:5]], first.plan.u[[1, 2, 3, 4, 4]])
    for command in rest[5:]:
        np.testing.assert_array_equal(command.u, MODEL.u_hover)
        assert command.plan is None


def test_one_solution_ends_the_fallback(monkeypatch):
    Failing(monkeypatch, lambda call: call in (2, 3, 5))
    answers = commands(LtvMpc(coupling="full"), 6)
    assert [c.qp.status == "solved" for c in answers] == [True, False, False, True, False, True]
    np.testing.assert_array_equal(answers[4].u, answers[3].plan.u[1])


def test_half_a_solution_is_none(monkeypatch):
    """Of the two parts of a step, one after the other, the second one fails from the second step on."""
    Failing(monkeypatch, lambda call: call in (4, 5))
    first, *rest = commands(LtvMpc(), 4)
    assert [c.qp.status for c in rest] == ["shifted_plan", "shifted_plan", "solved"]
    np.testing.assert_array_equal([c.u for c in rest[:2]], first.plan.u[1:3])


def test_without_any_plan_the_feed_forward_is_flown(monkeypatch):
    Failing(monkeypatch, lambda _: True)
    spec = LtvMpc()
    reference = planned(Circle(ramp=0.0), 0, spec.steps)
    command = decided(spec.start(), 0, reference.x[0], reference)
    # Nothing was solved: no iterations, active bounds, cost or slack.
    assert command.qp == ("shifted_plan", 0, 0, 0.0, 0.0)
    np.testing.assert_array_equal(command.u, reference.u[0])


def test_too_fast_is_softened_before_anything_else_is_tried():
    (command,) = commands(LtvMpc(), 1, [0, 0, 1, 0, 4.0, 0, 0, 0])
    assert command.qp.status == "softened"
    # 4 m/s less one period of full brake, 0.08 m/s, over 3 m/s; solved to 1e-4 of a penalty of 1e3.
    assert command.qp.slack == pytest.approx(0.92, abs=0.005)
    assert command.u[0] == pytest.approx(-1.0, abs=1e-3)


@pytest.mark.parametrize("lost", range(8))
def test_an_estimate_that_is_no_number_gives_a_safe_hover_and_nothing_else(lost):
    spec = LtvMpc()
    controller, undisturbed = spec.start(), spec.start()
    reference = planned(Hover(), 0, spec.steps)
    nothing = OFF.copy()
    nothing[lost] = np.nan
    for k in range(3):
        undisturbed.step(k, estimate(OFF), reference)
        controller.step(k, estimate(OFF), reference)
        command = controller.step(k, estimate(nothing), reference)
        # No problem was solved: no iteration, no active bound, no slack, no time.
        assert command.qp == QpReport("safe_hover", 0, 0, 0.0, 0.0)
        np.testing.assert_array_equal(command.u, MODEL.u_hover)
    # Neither the integral nor the plan has taken it in.
    after = [c.step(3, estimate(OFF), reference).u for c in (controller, undisturbed)]
    np.testing.assert_array_equal(*after)


@given(st.floats(-7, 7))
@settings(max_examples=20)
def test_a_turned_room_gets_the_same_inputs(angle):
    """Nothing in (26) knows where north is: x and y have the same weights."""
    c, s = np.cos(angle), np.sin(angle)
    turned = OFF.copy()
    turned[:2], turned[3] = [c * OFF[0] - s * OFF[1], s * OFF[0] + c * OFF[1]], OFF[3] + angle
    for spec in (LtvMpc(coupling="removed"), LtvMpc(coupling="full"), LtvMpc(terminal="riccati")):
        here = spec.start().step(0, estimate(OFF), planned(Hover(), 0, spec.steps)).u
        there = spec.start().step(0, estimate(turned), planned(Hover(yaw=angle), 0, spec.steps)).u
        np.testing.assert_allclose(there, here, rtol=0, atol=2 * SOLVER)


def test_integral_action_removes_a_constant_push():
    push = (0.1, 0.05, 0.0, 0.0)
    with_integral, wanted = flown(LtvMpc(), Hover(), 30.0, push=push)
    without, _ = flown(LtvMpc(k_i=0.0), Hover(), 10.0, push=push)
    # Without it the helicopter gives way until the position error balances the push: 2 cm and 1 cm.
    np.testing.assert_allclose(without[-1, :2], [0.020, 0.009], rtol=0, atol=0.001)
    # With the paper's gain that decays with a time constant of 6.5 s: a hundredth after 30 s.
    assert np.abs(with_integral[-1, :2] - wanted[-1, :2]).max() < 0.0005


@pytest.mark.parametrize("horizon", [1, 5, 18])
def test_the_riccati_weight_settles_from_afar_whatever_the_horizon(horizon):
    start = [0.5, -0.5, 1.2, 1.5, 0, 0, 0, 0]
    path, wanted = flown(LtvMpc(horizon=horizon, terminal="riccati"), Hover(yaw=1.0), 12.0, x=start)
    # Ten time constants of 1 s of the slowest pair, from 0.5 m.
    assert np.abs(path[-1, :4] - wanted[-1, :4]).max() < 1e-4
    if horizon == 1:
        shortsighted, _ = flown(LtvMpc(horizon=horizon), Hover(yaw=1.0), 12.0, x=start)
        assert np.abs(shortsighted[-1, :4] - wanted[-1, :4]).max() > 0.1


@pytest.mark.parametrize("spec", [LtvMpc(k_i=0.0), LtvMpc(Q=(*LtvMpc().Q[:8], 0.0, 0.0))], ids=["k_i", "Q"])
def test_integral_states_that_cost_nothing_are_left_out_of_the_riccati_weight(spec):
    spec = replace(spec, terminal="riccati")
    model = Linearisation(MODEL, spec.k_i, PERIOD, "removed", "euler")
    AB = model.discretise(model.jacobians(np.zeros((1, 10))))[0]
    P = np.zeros((10, 10))
    P[:8, :8] = solve_discrete_are(AB[:8, :8], AB[:8, 10:], np.diag(spec.Q[:8]), np.diag(spec.R))
    S = spec.start()._weights.sqrt_Qf
    # Both solvers keep twelve digits of the largest weight, 1e4.
    np.testing.assert_allclose(S.T @ S, P, rtol=0, atol=1e-6)
    path, wanted = flown(spec, Hover(), 12.0, x=[0.5, -0.5, 1.2, 0.5, 0, 0, 0, 0])
    assert np.abs(path[-1, :4] - wanted[-1, :4]).max() < 1e-3


@pytest.mark.parametrize("change", [{"R": (1e300,) * 4}, {"Q": (1e-300,) * 10}, {"k_i": 1e300}], ids=str)
def test_a_riccati_weight_that_does_not_exist_is_refused_in_a_sentence(change):
    with pytest.raises(ValueError, match=r"terminal = 'riccati' does not exist for these Q, R and k_i = .*'paper'"):
        replace(LtvMpc(terminal="riccati"), **change)
    replace(LtvMpc(), **change)


@pytest.mark.parametrize("coupling", ["removed", "full"])
@pytest.mark.parametrize("discretisation", ["euler", "exact"])
def test_every_variant_flies_the_circle(coupling, discretisation):
    path, wanted = flown(LtvMpc(coupling=coupling, discretisation=discretisation), Circle(), 6.0)
    error = np.abs(path - wanted)[100:]
    # What the held input makes of a turn of 0.02 rad a period: half a millimetre; height and yaw do not turn.
    assert error[:, :2].max() < 0.001
    assert error[:, 2].max() < 1e-6
    assert error[:, 3].max() < 1e-4


def test_limits_and_feed_forward_are_the_believed_model_s():
    spec = LtvMpc(model=replace(MODEL, u_x_max=0.3, u_yaw_max=0.1, b_z=20.0))
    (command,) = commands(spec, 1, [3.0, 0, 1.0, 1.0, 0, 0, 0, 0])
    assert np.abs(command.plan.u[:, 0]).max() == pytest.approx(0.3, abs=1e-4)
    assert np.abs(command.plan.u[:, 3]).max() == pytest.approx(0.1, abs=1e-4)
    nan = spec.start().step(0, estimate(np.full(8, np.nan)), planned(Hover(), 0, spec.steps))
    assert nan.u[2] == pytest.approx(9.81 / 20.0, rel=1e-15)


@pytest.mark.parametrize("turns", [-3, -1, 1, 40])
def test_whole_turns_of_the_estimate_are_no_error(turns):
    x, reference = np.array([0.05, -0.03, 1.02, 0.2, 0.1, 0.0, -0.1, 0.3]), planned(Hover(), 0, LtvMpc().steps)
    turned = x + np.array([0, 0, 0, 2.0 * np.pi * turns, 0, 0, 0, 0])
    expected, answer = (decided(LtvMpc().start(), 0, each, reference) for each in (x, turned))
    np.testing.assert_allclose(answer.plan.u, expected.plan.u, rtol=0, atol=1e-9)


def test_the_riccati_weight_is_turned_to_the_heading_at_the_end_of_the_horizon(monkeypatch):
    spec, headings = LtvMpc(terminal="riccati"), []
    turned = LtvMpcController._weights_at_heading
    monkeypatch.setattr(
        LtvMpcController, "_weights_at_heading", lambda self, yaw: headings.append(yaw) or turned(self, yaw)
    )
    reference = planned(Pirouette(rate=2.0, ramp=0.5), 100, spec.steps)
    answer = decided(spec.start(), 100, reference.x[0], reference)
    # Turning at 2 rad/s; the plan follows it, and what it began with has the planned inputs.
    assert headings == [pytest.approx(reference.x[-1, 3], abs=1e-3)]
    assert reference.x[-1, 3] - reference.x[1, 3] > 0.6
    assert answer.qp.status == "solved"
