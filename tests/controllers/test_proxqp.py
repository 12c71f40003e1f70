from dataclasses import replace
from typing import NamedTuple

import daqp
import numpy as np
import pytest
from scipy.optimize import nnls

from controllers.condensed_qp import CondensedQp
from controllers.laws.ltv_mpc import LtvMpc
from controllers.model import Model
from controllers.proxqp import ProxQp
from controllers.signals import Estimate, Reference

SPEC, MODEL = LtvMpc(coupling="full"), Model()
STEPS = SPEC.steps
AT_HOVER = np.array([0, 0, 1.0, 0, 0, 0, 0, 0])


def solver(spec=SPEC):
    return ProxQp(problem(AT_HOVER, spec=spec), 4)


def estimate(x):
    return Estimate(0, np.asarray(x, float), np.zeros(4), np.zeros((4, 3)), 0, 0)


def problem(x, u_ref=MODEL.u_hover, spec=SPEC):
    """The QP of (26) from a state towards hover at 1 m."""
    reference = Reference(0, np.tile(AT_HOVER, (STEPS + 1, 1)), np.tile(u_ref, (STEPS, 1)))
    (qp,) = spec.start().problem(estimate(x), reference)[1]
    return CondensedQp(*map(np.copy, qp))


def near(rng, size):
    return AT_HOVER + size * rng.uniform(-1, 1, 8) * [1, 1, 0.5, 1, 3, 3, 2, 25]


def bounds(qp):
    """All bounds as A du <= b."""
    eye = np.eye(len(qp.g))
    return np.vstack([qp.C, -qp.C, eye, -eye]), np.concatenate([qp.v_high, -qp.v_low, qp.u_high, -qp.u_low])


def inside_the_box(solution, qp):
    """To the 1e-4 that the softened attempt is solved to."""
    return bool((solution.du >= qp.u_low - 1e-4).all() and (solution.du <= qp.u_high + 1e-4).all())


TOLERANCE = 2e-4
"""The solver stops at a residual of 1e-5 in each of 76 gradients; the curvature is 2 at least."""


@pytest.mark.parametrize("seed", range(20))
def test_the_solution_is_the_minimiser(seed, minimiser):
    qp = problem(near(np.random.default_rng(seed), 0.4))
    solution = solver()(qp)
    assert solution is not None
    assert not solution.softened
    expected = minimiser(qp.H, qp.g, *bounds(qp))
    np.testing.assert_allclose(solution.du, expected, rtol=0, atol=TOLERANCE)
    objective = 0.5 * expected @ qp.H @ expected + qp.g @ expected
    # Flat at the minimum but for the active bounds.
    assert solution.objective == pytest.approx(objective, abs=1e-2)


@pytest.mark.parametrize("seed", range(20))
def test_karush_kuhn_tucker_hold_at_the_solution(seed):
    qp = problem(near(np.random.default_rng(seed), 0.4))
    solution = solver()(qp)
    A, b = bounds(qp)
    slack = b - A @ solution.du
    # Feasible to the solver's tolerance.
    assert slack.min() > -1e-4
    # Nonnegative multipliers of the bounds that hold with equality balance the gradient.
    _, unbalanced = nnls(A[slack < 1e-4].T, -(qp.H @ solution.du + qp.g))
    assert unbalanced < 1e-2
    # The problems are not trivial, or nothing was tested: without bounds it would be the gradient itself.
    assert np.linalg.norm(qp.H @ solution.du + qp.g) > 0.1


def test_inside_all_bounds_it_is_the_linear_equation():
    qp = problem([0.001, -0.001, 1.001, 0.001, 0, 0, 0, 0])
    solution = solver()(qp)
    assert solution.active_bounds == 0
    np.testing.assert_allclose(solution.du, np.linalg.solve(qp.H, -qp.g), rtol=0, atol=TOLERANCE)


def random_problems(seed, count, spec=SPEC):
    """QPs of unrelated states and nominal inputs, most of them with active bounds."""
    rng = np.random.default_rng(seed)
    for size in rng.choice([0.0, 0.01, 0.1, 0.3, 0.4], count):
        yield problem(near(rng, size), rng.uniform(MODEL.u_min, MODEL.u_max), spec)


def test_updated_qp_equals_fresh_qp():
    """H, g, C and all bounds change from step to step; not one digit may depend on the QPs solved before."""
    used = solver()
    for qp in [*random_problems(5, 40), problem([0, 0, 1, 0, 4.0, -5.0, 0, 0]), *random_problems(6, 10)]:
        again, fresh = used(qp), solver()(qp)
        for mine, theirs in zip(again, fresh, strict=True):
            np.testing.assert_array_equal(mine, theirs)


class Judged(NamedTuple):
    """How many answers an active-set solver of other authors finds wrong, and what they took."""

    wrong: int
    unsolved: int
    saturated: int
    iterations: int


def judged(spec, count):
    used, wrong, unsolved, saturated, iterations = solver(spec), 0, 0, 0, 0
    for qp in random_problems(5, count, spec):
        upper, lower = np.append(qp.u_high, qp.v_high), np.append(qp.u_low, qp.v_low)
        expected, _, flag, _ = daqp.solve(qp.H, qp.g, qp.C, upper, lower, np.zeros(len(upper), np.int32))
        assert flag == 1
        solution = used(qp)
        if solution is None or solution.softened:
            unsolved += 1
            continue
        wrong += bool(np.abs(solution.du - expected).max() > TOLERANCE)
        iterations += solution.iterations
        saturated += solution.active_bounds > 0
    return Judged(wrong, unsolved, saturated, iterations)


def test_daqp_agrees_with_every_answer():
    """Started from the previous result, ProxQP fails here.

    Of these 400 it then calls 13 to 27 solved that are not and gives up 4 to 53, in 2.2 times as many iterations.
    """
    answers = judged(SPEC, 400)
    assert (answers.wrong, answers.unsolved) == (0, 0)
    assert answers.saturated > 150
    # 1343 measured; from the previous result 2727.
    assert answers.iterations < 1500


@pytest.mark.parametrize(
    ("Q", "R"),
    [
        # Of 100 answers 9 and 11 are wrong without scaling and gap.
        (SPEC.Q, (1e-6,) * 4),
        (SPEC.Q, (1e-6, 2.0, 2.0, 2.0)),
        # 41 are wrong without the test of the duality gap, by up to 0.3 of full stick.
        ((0.0,) * 10, SPEC.R),
        ((0.0,) * 10, (1e-6,) * 4),
        ((50.0, *(0.0,) * 9), (2.0, 2.0, 0.1, 0.1)),
        (tuple(1e3 * q for q in SPEC.Q), SPEC.R),
    ],
)
def test_daqp_agrees_whatever_the_weights(Q, R):
    answers = judged(replace(SPEC, Q=Q, R=R), 100)
    assert answers.wrong == 0
    # Given up with hard bounds, softened, and said so.
    assert answers.unsolved <= 5
    assert answers.saturated > 10


def one_variable(high):
    """Minimise x^2/2 - 2x on [-1, high]."""
    row, far = np.array([[1.0]]), np.array([np.inf])
    return CondensedQp(row, np.array([-2.0]), row, -far, far, np.array([-1.0]), np.array([high]))


def test_a_relaxed_bound_is_used():
    """Without a test of complementarity, and started from x = 0.5, ProxQP calls 0.5 solved after no iteration."""
    used = ProxQp(one_variable(0.5), 1)
    assert used(one_variable(0.5)).du == pytest.approx(0.5, abs=1e-5)
    assert used(one_variable(3.0)).du == pytest.approx(2.0, abs=1e-5)


@pytest.mark.parametrize("scale", [1e20, 1e100, 1e300, np.nan])
def test_a_cost_too_large_for_the_tolerance_is_refused_at_once(scale, monkeypatch):
    """ProxQP would use up all its iterations: 60 ms to 2 s measured for state weights of 1e20 to 1e300."""
    qp, used = problem(near(np.random.default_rng(3), 0.3)), solver()
    for part in used._hard, used._soft:
        monkeypatch.setattr(part, "_qp", None)
    assert used(qp._replace(H=scale * qp.H)) is None
    assert used(qp._replace(g=scale * qp.g)) is None


def test_too_fast_a_start_is_softened_by_what_it_is_too_fast():
    """4 m/s against a limit of 3 m/s."""
    qp = problem([0, 0, 1, 0, 4.0, 0, 0, 0])
    solution = solver()(qp)
    assert solution.softened
    # Full brake takes (2 + 0.5 * 4) * 0.02 = 0.08 m/s off before the first predicted state.
    assert solution.slack == pytest.approx(0.92, abs=0.005)
    assert solution.du[0] == pytest.approx(-1.0, abs=1e-3)
    assert inside_the_box(solution, qp)


def test_softening_leaves_the_other_axes_within_their_limits():
    qp = problem([0, 0, 1, 0, 4.0, 0, 0, 0])
    reached = (qp.C @ solver()(qp).du).reshape(-1, 4)
    # The softened QP is solved to 1e-4 in each row.
    assert (reached[:, 1:] <= qp.v_high.reshape(-1, 4)[:, 1:] + 1e-3).all()
    assert (reached[:, 1:] >= qp.v_low.reshape(-1, 4)[:, 1:] - 1e-3).all()


def test_after_a_softened_one_the_next_is_as_good_as_new():
    used, calm = solver(), problem(near(np.random.default_rng(3), 0.3))
    for _ in range(2):
        assert used(problem([0, 0, 1, 0, 4.0, -5.0, 0, 0])).softened
        again, fresh = used(calm), solver()(calm)
        assert not again.softened
        np.testing.assert_allclose(again.du, fresh.du, rtol=0, atol=TOLERANCE)


def test_any_start_has_an_answer_in_bounded_work():
    """Up to twice the speed limits, as nothing keeps a gust from doing."""
    rng, used = np.random.default_rng(0), solver()
    kinds = {"hard": 0, "softened": 0, "none": 0}
    for _ in range(100):
        qp = problem(near(rng, 2.0))
        solution = used(qp)
        if solution is None:
            kinds["none"] += 1
            continue
        kinds["softened" if solution.softened else "hard"] += 1
        assert np.isfinite([*solution.du, solution.slack, solution.objective]).all()
        assert inside_the_box(solution, qp)
        # 9 times 12 of the hard and 20 times 60 of the softened attempt are allowed.
        assert 0 < solution.iterations < 300
    # Some need no softening, most do.
    assert kinds["hard"] > 0
    assert kinds["softened"] > 50
    assert kinds["none"] <= 1


def test_numbers_that_are_none_have_no_solution_and_leave_no_trace():
    used, calm = solver(), problem(near(np.random.default_rng(3), 0.3))
    assert used(calm._replace(g=np.full_like(calm.g, np.nan))) is None
    again = used(calm)
    assert again is not None
    np.testing.assert_allclose(again.du, solver()(calm).du, rtol=0, atol=TOLERANCE)


def test_where_memory_lies_does_not_change_a_digit():
    """Vectorised sums may start where an address is even; malloc promises 16 bytes, which some vectors outgrow."""
    rng, elsewhere = np.random.default_rng(0), []
    qps = [problem(near(rng, size)) for size in (0.0, 0.3, 0.4, 1.5)]
    answers = set()
    for _ in range(30):
        elsewhere.append((bytearray(int(rng.integers(1, 5000))), fresh := solver()))
        answers.add(b"".join(solution.du.tobytes() for solution in map(fresh, qps) if solution))
    assert len(answers) == 1
