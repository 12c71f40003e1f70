"""The steps of the fit: halved where they go to and fro, not where they are slow."""

from types import SimpleNamespace

import numpy as np
import pytest

from heli_twin.calibration.calibrate import _is_open
from heli_twin.calibration.fit import _bounded, _moved, _turns_back
from heli_twin.calibration.parameters import INDEX, NAMES, SPREAD
from heli_twin.calibration.unknowns import BEGIN, BEGIN_SHARE_S, N_LOG, N_START, State


def step(*values: float):
    return SimpleNamespace(step=np.array(values), covariance=np.diag([1.0, 100.0]), size=max(map(abs, values)))


@pytest.mark.parametrize(
    ("before", "now", "is_to_and_fro"),
    [
        ((1.0, 0.0), (-0.9, 0.0), True),
        # Slow, but on its way.
        ((1.0, 0.0), (0.9, 0.0), False),
        # Beyond the minimum, but soon there.
        ((1.0, 0.0), (-0.5, 0.0), False),
        # What counts is told in standard deviations: ten times as large for the second.
        ((1.0, -2.0), (-0.9, -2.0), True),
    ],
)
def test_a_step_is_halved_only_where_it_turns_back(before, now, is_to_and_fro):
    assert _turns_back(step(*before), step(*now)) == is_to_and_fro


@pytest.mark.parametrize(
    ("found", "believed", "is_open"),
    [
        (0.4, 1.0, True),
        # Three standard deviations away.
        (-1.5, 1.0, False),
        # Nobody believes it, so that it needs to be shown.
        (0.4, 0.0, False),
    ],
)
def test_an_effect_stays_if_it_is_believed_and_not_contradicted(found, believed, is_open):
    i, n = INDEX["ground_effect"], len(NAMES)
    theta, expected = np.zeros(n), np.zeros(n)
    theta[i], expected[i] = found, believed
    covariance = 0.7**2 * np.eye(n)
    fitted = SimpleNamespace(
        problem=SimpleNamespace(spread=SPREAD),
        state=SimpleNamespace(theta=theta),
        covariance=covariance,
        sandwich=covariance,
    )
    assert _is_open(fitted, "ground_effect", expected) == is_open


def test_a_step_keeps_to_the_bound_and_takes_the_others_along():
    n = len(NAMES)
    i, j = INDEX["drag_z_per_mass"], INDEX["thrust_lag"]
    covariance = np.eye(n)
    covariance[i, j] = covariance[j, i] = 0.5
    theta, step = np.zeros(n), np.zeros(n)
    theta[i], step[i], step[j] = 0.2, -0.5, 1.0
    problem, state = SimpleNamespace(spread=SPREAD), SimpleNamespace(theta=theta)
    bounded = _bounded(problem, state, covariance, step)
    # The mean of a normal distribution under the condition that the drag is zero.
    assert bounded[i] == pytest.approx(-0.2)
    assert bounded[j] == pytest.approx(1.0 + 0.5 * 0.3)
    assert np.array_equal(_bounded(problem, state, covariance, -step), -step)


@pytest.mark.parametrize(("asked", "is_at"), [(-0.004, -0.5), (0.0004, 0.2), (0.004, 0.5)])
def test_servos_begin_in_their_share_of_a_period(asked, is_at):
    n = len(NAMES)
    step = np.zeros(n + N_LOG)
    step[n + BEGIN] = asked
    state = State(np.zeros(n), np.zeros((1, N_LOG)), np.zeros((1, N_START)), np.zeros(9), (None,), (0.001,))
    equations = SimpleNamespace(to_start=lambda step: np.zeros((1, N_START)))
    now = SimpleNamespace(step=step, equations=equations, eta=state.eta)
    moved = _moved(SimpleNamespace(spread=SPREAD), state, now, 1.0)
    assert moved.nuisance[0, BEGIN] == pytest.approx(is_at * BEGIN_SHARE_S)
