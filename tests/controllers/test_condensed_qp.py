import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag, null_space, solve_discrete_are
from whole_model import whole

from controllers.condensed_qp import Condenser, Cost, Limits, Weights, riccati_terminal_weight
from controllers.ltv import SUBSYSTEMS, WHOLE, Linearisation
from controllers.model import Model
from controllers.planar import Planar

PERIOD, K_I = 0.02, 2.0
MODEL = Model()
LIMITS = Limits(np.array(MODEL.u_min), np.array(MODEL.u_max), np.array(MODEL.v_max), np.array(MODEL.u_slew))
seeds = st.integers(0, 2**32 - 1)
horizons = st.integers(1, 12)


class Problem:
    """One random instance of (26) and its stage costs, written as they are printed."""

    def __init__(self, seed, steps, speed=0.5):
        rng = np.random.default_rng(seed)
        x0 = rng.uniform(-1, 1, 10) * [1, 1, 1, 3, *(speed * LIMITS.v_max), 0.5, 0.5]
        u = rng.uniform(LIMITS.u_min, LIMITS.u_max, (steps, 4))
        self.steps = steps
        linearise = Linearisation(MODEL, K_I, PERIOD, "full", "euler")
        self.ltv = linearise(x0, u, rng.uniform(-1, 1, (steps + 1, 2)))
        self.x_ref = self.ltv.x_nominal + rng.uniform(-1, 1, (steps + 1, 10))
        self.u_ref = rng.uniform(LIMITS.u_min, LIMITS.u_max, (steps, 4))
        root = rng.uniform(-1, 1, (10, 10))
        self.Q, self.R, self.Qf = np.diag(rng.uniform(0.1, 50, 10)), np.diag(rng.uniform(0.5, 5, 4)), 10 * root.T @ root
        self.weights = Weights(np.sqrt(np.diag(self.Q)), np.diag(self.R), np.sqrt(10) * root)
        self.off = np.hstack([self.ltv.x_nominal[1:] - self.x_ref[1:], self.ltv.u_nominal - self.u_ref])
        self.A, self.B = whole(self.ltv)

    def condenser(self, limits=LIMITS):
        return Condenser(self.steps, limits, WHOLE, self.weights)

    def condensed(self, condenser=None):
        (AB,) = self.ltv.parts
        return (condenser or self.condenser())(AB, self.ltv.x_nominal, self.ltv.u_nominal, self.off)

    def states(self, u):
        x = [self.ltv.x_nominal[0]]
        for k in range(self.steps):
            dx, du = x[k] - self.ltv.x_nominal[k], u[k] - self.ltv.u_nominal[k]
            x.append(self.ltv.x_nominal[k + 1] + self.A[k] @ dx + self.B[k] @ du)
        return np.array(x)

    def cost(self, u):
        """Half the sum of (26); the measured state's own cost is a constant."""
        off, du = self.states(u) - self.x_ref, u - self.u_ref
        stages = sum(off[k] @ self.Q @ off[k] for k in range(self.steps)) + sum(d @ self.R @ d for d in du)
        return 0.5 * (stages + off[-1] @ self.Qf @ off[-1])

    def dynamics(self):
        """E z = e for z = (x_1 .. x_N, u_0 .. u_N-1): the equality constraints of (26)."""
        n, ltv = self.steps, self.ltv
        E, e = np.zeros((10 * n, 14 * n)), np.zeros(10 * n)
        for k in range(n):
            rows = slice(10 * k, 10 * k + 10)
            E[rows, rows] = np.eye(10)
            E[rows, 10 * n + 4 * k : 10 * n + 4 * k + 4] = -self.B[k]
            e[rows] = ltv.x_nominal[k + 1] - self.A[k] @ ltv.x_nominal[k] - self.B[k] @ ltv.u_nominal[k]
            if k:
                E[rows, 10 * k - 10 : 10 * k] = -self.A[k]
            else:
                e[rows] += self.A[0] @ ltv.x_nominal[0]
        return E, e

    def sparse(self):
        """1/2 z'P z + p'z over the same z."""
        n = self.steps
        P = block_diag(*[self.Q] * (n - 1), self.Qf, *[self.R] * n)
        return P, -P @ np.concatenate([self.x_ref[1:].ravel(), self.u_ref.ravel()])


@given(seeds, horizons)
@settings(max_examples=50)
def test_along_any_inputs_the_objective_is_the_sum_of_the_stage_costs(seed, steps):
    problem, rng = Problem(seed, steps), np.random.default_rng(seed)
    qp = problem.condensed()
    u, nominal = rng.uniform(LIMITS.u_min, LIMITS.u_max, (steps, 4)), problem.ltv.u_nominal
    du = (u - nominal).ravel()
    gained = 0.5 * du @ qp.H @ du + qp.g @ du
    costs = [problem.cost(u), problem.cost(nominal)]
    # Rounding of sums of a few hundred terms that nearly cancel.
    assert gained == pytest.approx(costs[0] - costs[1], abs=1e-11 * max(costs))


@given(seeds, horizons)
@settings(max_examples=50)
def test_without_active_bounds_the_minimiser_is_the_sparse_one(seed, steps):
    problem = Problem(seed, steps)
    qp, (P, p), (E, e) = problem.condensed(), problem.sparse(), problem.dynamics()
    kkt = np.block([[P, E.T], [E, np.zeros((len(E), len(E)))]])
    z = np.linalg.solve(kkt, np.concatenate([-p, e]))[: 14 * steps]
    u = problem.ltv.u_nominal.ravel() + np.linalg.solve(qp.H, -qp.g)
    # The conditions of H and of the KKT matrix are up to 1e5; inputs of up to 100.
    np.testing.assert_allclose(u, z[10 * steps :], rtol=0, atol=1e-7)
    states = problem.states(u.reshape(-1, 4))[1:]
    np.testing.assert_allclose(states.ravel(), z[: 10 * steps], rtol=0, atol=1e-7)


@pytest.mark.parametrize("seed", range(20))
def test_with_active_bounds_the_minimiser_is_the_sparse_one(seed, minimiser):
    # Nearly as fast as is allowed, and turning slowly enough to be able to stay below that.
    problem = Problem(seed, steps := 4, speed=np.array([1.0, 1.0, 1.0, 0.02]))
    limits = LIMITS._replace(v_max=1.01 * np.abs(problem.ltv.x_nominal[0, 4:8]))
    qp = problem.condensed(problem.condenser(limits))
    (P, p), (E, e) = problem.sparse(), problem.dynamics()
    du = minimiser(
        qp.H,
        qp.g,
        np.vstack([qp.C, -qp.C, np.eye(4 * steps), -np.eye(4 * steps)]),
        np.concatenate([qp.v_high, -qp.v_low, qp.u_high, -qp.u_low]),
    )
    free = np.full(10, np.inf)
    free[4:8] = limits.v_max
    z_max = np.concatenate([np.tile(free, steps), np.tile(LIMITS.u_max, steps)])
    z_min = np.concatenate([-np.tile(free, steps), np.tile(LIMITS.u_min, steps)])
    # Any point of the dynamics and a basis of what they leave free, found without knowing what is a state.
    point, basis = np.linalg.lstsq(E, e)[0], null_space(E)
    free_part = minimiser(
        basis.T @ P @ basis,
        basis.T @ (P @ point + p),
        np.vstack([basis, -basis]),
        np.concatenate([z_max - point, point - z_min]),
    )
    z = point + basis @ free_part
    at_bound = [np.minimum(v - low, high - v) < 1e-9 for v, low, high in ((du, *qp[5:]), (qp.C @ du, *qp[3:5]))]
    assert all(some.any() and not some.all() for some in at_bound)
    # Conditions of up to 1e5 and distances of up to 1e3 in the least distance problem.
    np.testing.assert_allclose(problem.ltv.u_nominal.ravel() + du, z[10 * steps :], rtol=0, atol=1e-8)


@given(seeds, horizons)
@settings(max_examples=50)
def test_its_rows_are_the_predicted_velocities_within_their_limits(seed, steps):
    problem = Problem(seed, steps)
    qp = problem.condensed()
    u = np.random.default_rng(seed).uniform(LIMITS.u_min, LIMITS.u_max, (steps, 4))
    # States 1 .. N: the measured one has no row.
    velocities, du = problem.states(u)[1:, 4:8], (u - problem.ltv.u_nominal).ravel()
    # Rounding of velocities up to 25 rad/s.
    np.testing.assert_allclose(qp.C @ du - qp.v_high, (velocities - LIMITS.v_max).ravel(), rtol=0, atol=1e-12)
    np.testing.assert_allclose(qp.C @ du - qp.v_low, (velocities + LIMITS.v_max).ravel(), rtol=0, atol=1e-12)
    # Rounding of inputs up to 1.
    np.testing.assert_allclose(du - qp.u_low, (u - LIMITS.u_min).ravel(), rtol=0, atol=1e-15)
    np.testing.assert_allclose(du - qp.u_high, (u - LIMITS.u_max).ravel(), rtol=0, atol=1e-15)


@given(seeds, horizons)
@settings(max_examples=50)
def test_servos_of_limited_speed_add_rows_for_the_changes_of_the_inputs(seed, steps):
    problem, rng = Problem(seed, steps), np.random.default_rng(seed)
    travel, (before, *u) = np.array([0.05, 0.1, np.inf, 0.2]), rng.uniform(LIMITS.u_min, LIMITS.u_max, (steps + 1, 4))
    condenser, nominal = problem.condenser(LIMITS._replace(travel=travel)), problem.ltv.u_nominal
    free, (AB,) = problem.condensed(), problem.ltv.parts
    cost = condenser.cost(AB, problem.ltv.x_nominal, problem.off)
    qp = condenser.bounded(cost, problem.ltv.x_nominal, nominal, before)
    np.testing.assert_array_equal(qp.C[: 4 * steps], free.C)
    np.testing.assert_array_equal(qp.v_low[: 4 * steps], free.v_low)
    # Row by row: the change since the period before, minus what is allowed.
    rows, du = slice(4 * steps, None), (np.array(u) - nominal).ravel()
    changes = np.array(u) - [before, *u[:-1]]
    np.testing.assert_allclose(qp.C[rows] @ du - qp.v_high[rows], (changes - travel).ravel(), rtol=0, atol=1e-14)
    np.testing.assert_allclose(qp.C[rows] @ du - qp.v_low[rows], (changes + travel).ravel(), rtol=0, atol=1e-14)


def test_a_measured_state_that_noise_has_put_over_its_limit_leaves_a_solution():
    x0 = np.array([0, 0, 1, 0, 3.03, 0, 0, 0, 0, 0])
    u = np.tile([-1.0, 0.0, MODEL.u_hover[2], 0.0], (5, 1))
    ltv = Linearisation(MODEL, K_I, PERIOD, "full", "euler")(x0, u, np.zeros((6, 2)))
    ones = Weights(np.ones(10), np.ones(4), np.eye(10))
    off = np.hstack([ltv.x_nominal[1:], np.zeros((5, 4))])
    qp = Condenser(5, LIMITS, WHOLE, ones)(ltv.parts[0], ltv.x_nominal, u, off)
    # Full brake takes 0.07 m/s off in the first period: no departure from it is needed.
    assert (qp.v_high >= 0.0).all()
    assert (qp.v_low <= 0.0).all()


@given(seeds, horizons)
@settings(max_examples=50)
def test_the_response_is_the_linear_model(seed, steps):
    problem = Problem(seed, steps)
    condenser = problem.condenser()
    problem.condensed(condenser)
    u = np.random.default_rng(seed).uniform(LIMITS.u_min, LIMITS.u_max, (steps, 4))
    # The same products in another order; yaw of up to 10 rad.
    departed = condenser.response(u - problem.ltv.u_nominal)
    np.testing.assert_allclose(problem.ltv.x_nominal + departed, problem.states(u), rtol=0, atol=1e-12)


@given(seeds, horizons, st.sampled_from([0, 1]))
@settings(max_examples=20)
def test_without_bounds_the_gradient_vanishes_at_the_minimiser(seed, steps, place):
    subsystem, problem = SUBSYSTEMS["removed"][place], Problem(seed, steps)
    ltv = Linearisation(MODEL, K_I, PERIOD, "removed", "exact")(
        np.random.default_rng(seed).uniform(-1, 1, 10), problem.ltv.u_nominal, np.zeros((steps + 1, 2))
    )
    condenser = Condenser(steps, LIMITS, subsystem, Weights(np.arange(1.0, 11.0), np.ones(4), np.eye(10)).of(subsystem))
    cost = condenser.cost(ltv.parts[place], ltv.x_nominal, problem.off)
    du = condenser.minimiser(cost)
    # Rounding, of sums of so large terms.
    np.testing.assert_allclose(cost.H @ du, -cost.g, rtol=0, atol=1e-12 * (np.abs(cost.H) @ np.abs(du)).max())


def test_a_cost_without_curvature_has_no_minimiser():
    cost = Cost(np.ones((2, 2)), np.ones(2), np.eye(2))
    with np.errstate(all="ignore"):
        assert np.isnan(Problem(0, 1).condenser().minimiser(cost)).all()


@given(st.lists(seeds, min_size=2, max_size=4), horizons)
@settings(max_examples=30)
def test_a_condenser_remembers_nothing(problem_seeds, steps):
    used = Problem(problem_seeds[0], steps).condenser()
    for seed in problem_seeds:
        problem = Problem(seed, steps)
        problem.weights = Problem(problem_seeds[0], steps).weights
        qp = problem.condensed(used)
        for again, fresh in zip(qp, problem.condensed(), strict=True):
            np.testing.assert_array_equal(again, fresh)


@given(st.tuples(seeds, seeds), horizons, st.sampled_from(["euler", "exact"]))
@settings(max_examples=20)
def test_a_constant_part_is_condensed_once_and_for_all(problem_seeds, steps, method):
    linearise = Linearisation(MODEL, K_I, PERIOD, "removed", method)
    all_weights = Weights(np.arange(1.0, 11.0), np.ones(4), np.eye(10))
    found = []
    for place, subsystem in enumerate(SUBSYSTEMS["removed"]):
        weights = all_weights.of(subsystem)
        kept = Condenser(steps, LIMITS, subsystem, weights)
        for seed in problem_seeds:
            problem, start = Problem(seed, steps), np.random.default_rng(seed).uniform(-1, 1, 10)
            ltv = linearise(start, problem.ltv.u_nominal, np.zeros((steps + 1, 2)))
            again, fresh = (
                c(ltv.parts[place], ltv.x_nominal, ltv.u_nominal, problem.off)
                for c in (kept, Condenser(steps, LIMITS, subsystem, weights))
            )
            for one, other in zip(again, fresh, strict=True):
                np.testing.assert_array_equal(one, other)
            found.append(again)
    assert found[2].H is found[3].H
    assert found[2].C is found[3].C
    assert found[0].H is not found[1].H


@given(seeds, horizons)
@settings(max_examples=30)
def test_the_hessian_is_symmetric_and_convex(seed, steps):
    problem = Problem(seed, steps)
    H = problem.condensed().H
    # Solvers read one triangle or both.
    np.testing.assert_allclose(H, H.T, rtol=0, atol=1e-12 * np.abs(H).max())
    # Each input costs its own weight at least; eigenvalues are rounded at 1e-16 of the largest.
    assert np.linalg.eigvalsh(H).min() >= np.diag(problem.R).min() - 1e-12 * np.abs(H).max()


@pytest.mark.parametrize("method", ["euler", "exact"])
def test_the_riccati_weight_is_the_cost_to_go(method):
    level = Linearisation(MODEL, K_I, PERIOD, "removed", method)
    A, B = np.split(level.discretise(level.jacobians(np.zeros((1, 10))))[0], [10], axis=1)
    Q, R = np.diag([50.0, 50, 5, 10, 3, 3, 1, 2, 15, 15]), 2 * np.eye(4)
    P = riccati_terminal_weight(A, B, Q, R)
    # Both solvers lose some five digits of a cost-to-go that integrates over a hundred steps.
    np.testing.assert_allclose(P, solve_discrete_are(A, B, Q, R), rtol=0, atol=1e-9 * np.abs(P).max())
    np.testing.assert_array_equal(P, P.T)
    # One more stage changes nothing.
    K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    one_more = Q + K.T @ R @ K + (A - B @ K).T @ P @ (A - B @ K)
    np.testing.assert_allclose(one_more, P, rtol=0, atol=1e-10 * np.abs(P).max())


def test_what_costs_nothing_has_no_cost_to_go():
    P = riccati_terminal_weight(0.5 * np.eye(10), np.eye(10)[:, :4], np.zeros((10, 10)), np.eye(4))
    np.testing.assert_array_equal(P, np.zeros((10, 10)))


def test_what_no_input_can_stop_has_no_riccati_weight():
    with pytest.raises(ValueError, match="no stabilising solution"), np.errstate(all="ignore"):
        riccati_terminal_weight(np.eye(10), np.zeros((10, 4)), np.eye(10), np.eye(4))


def test_one_step_of_the_plainest_model_by_hand():
    """x+ = x + u in the first state: minimise 1/2 (x + u - 3)^2 * 4 + 1/2 u^2 * 2 from x = 1."""
    AB = np.eye(10, 14)[None]
    AB[0, 0, 10] = 1.0
    x = np.zeros((2, 10))
    x[:, 0] = 1.0
    weights = Weights(np.zeros(10), np.full(4, 2.0), 2 * np.eye(10))
    off = x.copy()
    off[1, 0] -= 3.0
    still = np.zeros((1, 4))
    qp = Condenser(1, LIMITS, WHOLE, weights)(AB, x, still, np.hstack([off[1:], still]))
    np.testing.assert_array_equal(qp.H, np.diag([6.0, 2.0, 2.0, 2.0]))
    np.testing.assert_array_equal(qp.g, [-8.0, 0.0, 0.0, 0.0])


@given(seeds, horizons, st.lists(st.sampled_from([0.0, 1.0, 7.0]), min_size=6, max_size=6))
@settings(max_examples=40)
def test_the_closed_form_of_the_plane_is_its_recursion(seed, steps, roots):
    plane, rng = SUBSYSTEMS["removed"][0], np.random.default_rng(seed)
    linearise = Linearisation(MODEL, K_I, PERIOD, "removed", "euler")
    weights = Weights(np.array(roots), np.array([0.5, 3.0]), rng.uniform(-1, 1, (6, 6)))
    level = linearise(np.zeros(10), np.tile(MODEL.u_hover, (steps, 1)), np.zeros((steps + 1, 2))).parts[0]
    closed = Condenser(steps, LIMITS, plane, weights, Planar(level, weights))
    stepwise = Condenser(steps, LIMITS, plane, weights)
    for _ in range(2):
        problem = Problem(rng.integers(1 << 32), steps)
        ltv = linearise(problem.ltv.x_nominal[0], problem.ltv.u_nominal, np.zeros((steps + 1, 2)))
        root = rng.uniform(-1, 1, (6, 6))
        one = closed(None, ltv.x_nominal, ltv.u_nominal, problem.off, root)
        other = stepwise(ltv.parts[0], ltv.x_nominal, ltv.u_nominal, problem.off, root)
        for a, b in zip(one, other, strict=True):
            # The same sums in another order.
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * max(1.0, np.abs(b).max()))
        du = rng.uniform(-1, 1, (steps, 2))
        np.testing.assert_allclose(closed.response(du), stepwise.response(du), rtol=0, atol=1e-13)
