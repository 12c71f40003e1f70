"""The covariance of a window: its responses are the twin's, and REML finds the variances that made the residuals."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from heli_twin.calibration import noise
from heli_twin.calibration.data import BINS
from heli_twin.calibration.parameters import INDEX, NAMES, of_experiment, vector
from heli_twin.experiment.text import load

THETA = vector(np.array([of_experiment(load("lab"))[name] for name in NAMES]))


def test_steady_wind_carries_the_helicopter_along_and_tilts_it():
    response = noise.wind_response(THETA, np.zeros((1, BINS)))[0]
    drift = response.reshape(4, BINS, 2, BINS)[:, :, 0].sum(axis=-1)
    k, hub = np.exp(THETA[INDEX["drag_x_per_mass"]]), THETA[INDEX["hub_drag_per_iyy"]]
    w2 = np.exp(2.0 * THETA[INDEX["attitude_frequency"]])
    # Relative wind 1 - v at the end: it tilts by hub k (1 - v) / w^2 and falls with g times that.
    speed = (drift[0, -1] - drift[0, -2]) / noise.BIN_S
    assert 0.5 < speed < 1.0
    assert drift[2, -1] == pytest.approx(hub * k * (1.0 - speed) / w2, rel=0.1)
    assert np.abs(drift[[1, 3]]).max() < 1e-12


def test_a_heading_turns_the_response():
    north = noise.wind_response(THETA, np.zeros((1, BINS)))[0].reshape(4, BINS, 2, BINS)
    west = noise.wind_response(THETA, np.full((1, BINS), 0.5 * np.pi))[0].reshape(4, BINS, 2, BINS)
    # Nose to the west: wind from there pitches it, and moves it west as the north wind moved it north.
    assert west[2, :, 1] == pytest.approx(north[2, :, 0], abs=1e-9)
    assert west[1, :, 1] == pytest.approx(north[0, :, 0], abs=1e-9)


def test_reml_finds_the_variances():
    # The matrices are small: threads would only wait for each other.
    with threadpool_limits(limits=1):
        _reml_finds_the_variances()


def _reml_finds_the_variances():
    rng = np.random.default_rng(4)
    w = 16
    true = np.log(np.array([0.3, 0.5, 1.0, 0.0006, 0.0004, 0.004, 0.2, 3.0, 0.006]))
    frames = np.full((w, BINS), 2.0)
    frames[3, 20:25] = 0.0
    air = noise.windage(THETA, np.zeros((w, BINS)), frames)
    rows = np.zeros((w, BINS, 6, 1))
    for weights in noise.weighted(air, true, with_parts=False):
        for name, (inverse, part) in noise.blocks(weights, rows).items():
            root = np.linalg.cholesky(np.linalg.inv(inverse))
            part[...] = root @ rng.standard_normal(part.shape)
            channels = {"plane": noise.PLANE, "z": (2,), "yaw": (3,)}[name]
            part = part[..., 0].reshape(len(part), len(channels), BINS)
            rows[weights.windows][:, :, channels, 0] = np.moveaxis(part, 1, 2)
    t = noise.BIN_S * np.arange(BINS)
    first = np.zeros((w, BINS, 6, 12))
    for i in range(6):
        first[:, :, i, i], first[:, :, i, 6 + i] = 1.0, t
    seen = (frames > 0)[:, :, None, None]
    rows, first, eta = rows * seen, first * seen, np.log(noise.PRIOR)
    for _ in range(6):
        reml = noise.Reml()
        for weights in noise.weighted(air, eta, with_parts=True):
            residual = {name: part for name, (_, part) in noise.blocks(weights, rows).items()}
            nuisance = {name: part for name, (_, part) in noise.blocks(weights, first).items()}
            inverse = {"plane": weights.plane, "z": weights.z, "yaw": weights.yaw}
            m = sum(x.transpose(0, 2, 1) @ inverse[name] @ x for name, x in nuisance.items())
            reml.add(weights, residual, nuisance, m + 1e-9 * np.eye(12))
        eta, covariance = reml.step(eta)
    distance = (eta - true) / np.sqrt(np.diag(covariance))
    # Nine of them: beyond 3.5 standard deviations one time in 200.
    assert np.abs(distance).max() < 3.5
    assert np.sqrt(np.diag(covariance))[[0, 4, 5, 8]].max() < 0.15
