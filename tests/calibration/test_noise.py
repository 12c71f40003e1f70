"""The covariance of a window: whitened chance is white, and REML finds the variances that made the residuals."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from controllers.model import GRAVITY
from heli_twin.calibration import noise
from heli_twin.calibration.data import BINS, WINDOW_STEPS
from heli_twin.calibration.motion import STRIDE, Lanes, simulate, transitions
from heli_twin.calibration.parameters import NAMES, lab_of, of_experiment, vector
from heli_twin.experiment.text import load

LAB = load("lab")
THETA = vector(np.array([of_experiment(LAB)[name] for name in NAMES]))
WINDOWS = 12
WEIGHTS = np.zeros((WINDOWS, WINDOW_STEPS + 1))
# Two poses in each bin.
WEIGHTS[:, 3:WINDOW_STEPS:10] = 0.5
EARLY = np.zeros((WINDOWS, BINS))
FRAMES = np.full((WINDOWS, BINS), 2.0)
TRUE = np.log(np.array([0.1, 0.6, 0.7, 0.0006, 0.0004, 0.004, 0.2, 3.0, 0.006]))


def lanes(wind=None) -> Lanes:
    """Windows that begin tilted, turned and moving."""
    start = np.zeros((1, WINDOWS, 12))
    start[..., 2], start[..., 3], start[..., 6:9] = 1.0, 0.5, np.linspace(-0.3, 0.6, WINDOWS)[:, None]
    start[..., 7:9] *= 0.4
    drive = np.zeros((WINDOW_STEPS, 1, 4, WINDOWS))
    drive[:, :, 2] = GRAVITY
    return Lanes(THETA[None], start, np.zeros((1, WINDOWS, 3)), drive, np.zeros(1, int), wind)


@pytest.fixture(scope="module")
def air() -> noise.Windage:
    return noise.Windage(transitions(lanes(), WEIGHTS, EARLY, lab_of(LAB)), FRAMES)


def chained(air: noise.Windage, wind):
    """The poses (w, BINS, 6) that a wind (w, BINS, 2) adds, by the linearised equations."""
    t, state, out = air.transitions, np.zeros((WINDOWS, 12)), np.zeros((WINDOWS, BINS, 6))
    for k in range(BINS):
        out[:, k] = np.einsum("wij,wj->wi", t.pose[:, k], state)
        out[:, k] += np.einsum("wij,wj->wi", t.pose_by_wind[:, k], wind[:, k])
        state = np.einsum("wij,wj->wi", t.state[:, k], state)
        state += np.einsum("wij,wj->wi", t.state_by_wind[:, k], wind[:, k])
    return out


def test_wind_moves_the_linearised_equations_as_the_twins(air):
    wind = np.broadcast_to(np.array([0.05, -0.03]), (1, WINDOWS, 2))
    moved, still = (simulate(lanes(w), WEIGHTS, EARLY, lab_of(LAB))[0] for w in (wind, None))
    found = chained(air, np.broadcast_to(wind[0][:, None], (WINDOWS, BINS, 2)))
    # Steps of 4 ms, and what is of second order in the wind.
    assert np.abs(found - (moved - still)).max() < 0.03 * np.abs(moved - still).max()
    assert np.abs(moved - still)[..., 0].max() > 0.01


def test_longer_steps_show_the_same_differences():
    names = ("attitude_frequency", "drag_x_per_mass", "hub_drag_per_iyy", "yaw_damping_per_izz")
    one, varied = lanes(), np.repeat(THETA[None], 1 + len(names), axis=0)
    varied[range(1, 1 + len(names)), [NAMES.index(name) for name in names]] += 1e-3
    many = one._replace(theta=varied, which=np.zeros(len(varied), int))
    many = many._replace(start=np.repeat(one.start, len(varied), axis=0), push=np.repeat(one.push, len(varied), axis=0))
    # Parameters that move free helicopters; one pose in the middle of 4 ms lies between two of the longer steps.
    fine, coarse = (np.diff(simulate(many, WEIGHTS, EARLY, lab_of(LAB), n), axis=0) for n in (1, STRIDE))
    for a, b in zip(fine, coarse, strict=True):
        assert np.abs(a - b).max() < 0.03 * np.abs(a).max()


def residuals(air, rng):
    """Residuals with the variances `TRUE`."""
    s, w = np.exp(TRUE), WINDOWS
    wind, slow = np.empty((w, BINS, 2)), np.empty((w, BINS, 3))
    for series, strength, time in ((wind, s[0], s[1]), (slow, s[3], noise.SLOW_TIME_S)):
        keep = np.exp(-noise.BIN_S / time)
        series[:, 0] = strength * rng.standard_normal(series[:, 0].shape)
        for k in range(1, BINS):
            chance = strength * np.sqrt(1.0 - keep**2) * rng.standard_normal(series[:, 0].shape)
            series[:, k] = keep * series[:, k - 1] + chance
    out = chained(air, wind)
    state, t = np.zeros((w, 12)), air.transitions
    jitter = np.array([0.0, 0.0, s[6], s[7], s[2], s[2]])
    for k in range(BINS):
        out[:, k] += np.einsum("wij,wj->wi", t.pose[:, k], state)
        push = jitter * rng.standard_normal((w, 6))
        state = np.einsum("wij,wj->wi", t.state[:, k], state)
        state += np.concatenate([0.5 * noise.BIN_S**2 * push, noise.BIN_S * push], axis=1)
    out[..., :3] += slow
    white = np.array([s[4], s[4], s[4], s[8], s[5], s[5]]) / np.sqrt(2.0)
    return out + white * rng.standard_normal(out.shape)


def first_states(air):
    """Derivatives (w, BINS, 6, 12) by the first state."""
    t, state, out = air.transitions, np.broadcast_to(np.eye(12), (WINDOWS, 12, 12)), []
    for k in range(BINS):
        out.append(t.pose[:, k] @ state)
        state = t.state[:, k] @ state
    return np.stack(out, axis=1)


def test_reml_finds_the_variances_and_what_they_whiten_is_white(air):
    # The matrices are small: threads would only wait for each other.
    with threadpool_limits(limits=1):
        rows, first, eta = residuals(air, np.random.default_rng(4)), first_states(air), np.log(noise.PRIOR)
        for _ in range(6):
            eta, covariance = noise.next_variances(air, eta, rows, first)
        white, _ = noise.whiten(air, TRUE, rows[..., None])
    deviation = np.sqrt(np.diag(covariance))
    # Nine of them: beyond 3.5 standard deviations one time in 200.
    assert np.abs((eta - TRUE) / deviation).max() < 3.5
    assert deviation[[0, 4, 5, 8]].max() < 0.2
    # 7200 numbers have a variance of 1, known to 1.7 %; the first bins hold the wind that is taken as unknown.
    assert white[:, 15:].var() == pytest.approx(1.0, abs=0.06)


def test_reml_knows_what_parameters_took_from_the_residuals(air):
    rng = np.random.default_rng(6)
    rows, first, eta = residuals(air, rng), first_states(air), [TRUE, TRUE, TRUE]
    # Twenty parameters of all windows that look like winds, fitted and taken away.
    winds = rng.standard_normal((20, WINDOWS, 1, 2)) * np.ones((1, 1, BINS, 1))
    winds *= np.cos(np.outer(rng.uniform(0.0, 6.0, 20), noise.BIN_S * np.arange(BINS)))[:, None, :, None]
    jacobian = np.stack([chained(air, wind) for wind in winds], axis=-1)
    with threadpool_limits(limits=1):
        both = np.concatenate([first, jacobian, rows[..., None]], axis=-1)
        white = noise.whiten(air, TRUE, both, np.exp(TRUE[0]))[0].reshape(WINDOWS, -1, 33)
        wide = np.zeros((WINDOWS * BINS * 6, 12 * WINDOWS + 20))
        for i in range(WINDOWS):
            of_window = slice(i * BINS * 6, (i + 1) * BINS * 6)
            wide[of_window, 12 * i : 12 * i + 12], wide[of_window, -20:] = white[i, :, :12], white[i, :, 12:32]
        fitted = np.linalg.lstsq(wide, white[..., -1].ravel(), rcond=None)[0][-20:]
        left = rows - jacobian @ fitted

        def taken(local, scores):
            matrix, vector = local.sum(axis=0), scores.sum(axis=0)
            return np.linalg.slogdet(matrix)[1], vector @ np.linalg.solve(matrix, vector)

        lost = noise.Explained(jacobian, taken)
        for _ in range(3):
            given = zip(eta, (rows, left, left), (None, None, lost), strict=True)
            eta = [noise.next_variances(air, e, r, first, x)[0] for e, r, x in given]
    whole, naive, right = (np.exp(e - TRUE)[0] for e in eta)
    # Twelve windows have some hundred independent winds, of which the parameters took twenty.
    assert naive < 0.96 * whole
    assert right == pytest.approx(whole, rel=0.05)


def test_where_there_is_no_pose_nothing_is_learned(air):
    blind = air._replace(frames=np.where(np.arange(BINS) == 40, 0.0, FRAMES))
    rows = np.zeros((WINDOWS, BINS, 6, 1))
    rows[:, 60] = 1.0
    white, roots = noise.whiten(blind, TRUE, rows)
    assert np.abs(white[:, 40]).max() == 0.0
    assert roots[:, 40] == pytest.approx(np.broadcast_to(np.eye(6), (WINDOWS, 6, 6)))


def test_what_is_foreseen_errs_as_much_as_it_says(air):
    rng, history = np.random.default_rng(5), 50
    errors = []
    with threadpool_limits(limits=1):
        for _ in range(4):
            rows = residuals(air, rng)
            seen = noise.foresee(air, TRUE, rows[..., None], history)
            errors.append((rows[:, history:] - seen.mean[..., 0]) / np.sqrt(seen.variance))
            blind = np.where(np.arange(BINS)[:, None] < history, rows, 0.0)
            # The future is not looked at.
            assert np.array_equal(noise.foresee(air, TRUE, blind[..., None], history).mean, seen.mean)
    # 48 windows, whose errors are correlated within one, mostly in the plane: a variance is known to a fifth.
    variance = np.mean(np.square(errors), axis=(0, 1, 2))
    assert variance == pytest.approx(np.ones(6), rel=0.4)
    assert variance.mean() == pytest.approx(1.0, rel=0.2)
