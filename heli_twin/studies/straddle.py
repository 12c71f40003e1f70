"""Learning where a function crosses zero from few of its values. The only module that imports scikit-learn.

A Gaussian process is fitted to the values so far. The next point is where its sign is least certain: the straddle, 1.96
standard deviations less the distance of the mean from zero, is greatest there. Of points that are asked for together,
each is chosen as if those before it had come out as expected.

Source: Bryan, Schneider, Nichol, Miller, Genovese and Wasserman, Active learning for identifying function threshold
boundaries, NIPS 18 (2005); Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), chapters 2 and 5.
"""

import warnings
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr
from threadpoolctl import threadpool_limits

from controllers.signals import Array
from heli_twin.reporting.intervals import Interval
from heli_twin.studies.errors import StudyError

CANDIDATES_LOG2 = 12
"""The next points are chosen among so many of the unit cube: the choice does not hang on the last digits."""
NEAREST = 1e-3
"""Two places are further apart along one axis at least: the same flight again tells nothing."""
LENGTHS = (0.05, 10.0)
"""Bounds of the distance over which the function changes, in widths of an axis."""
NOISE = (1e-6, 1.0)
"""Bounds of the variance of a value that is not the function's, as a share of that of all values."""
RESTARTS = 1
DRAWS = 400
"""Functions that are drawn for the interval of a share."""
DRAW_PLACES_LOG2 = 10
WIDER = 2.0
"""The draws take the fitted lengths and noise as known. Of random functions their own width held the share of 59 in 60
(two axes, 80 points) and of 4 in 8 (six axes, 160 points); twice of it that of all."""
Z95 = 1.959964


class Surrogate(NamedTuple):
    """A Gaussian process that was fitted to values of a function."""

    process: Any
    scale: float
    """The process is that of the values divided by this."""

    def predict(self, places: Array) -> tuple[Array, Array]:
        """Return mean and standard deviation of the function at places, (n,) each.

        Args:
            places: (n, d) in the unit cube.
        """
        with threadpool_limits(1), warnings.catch_warnings():
            # A variance that rounding makes negative is 0.
            warnings.simplefilter("ignore")
            mean, deviation = self.process.predict(places, return_std=True)
        return self.scale * mean, self.scale * deviation

    def above(self, places: Array) -> Array:
        """Return the probability that the function is above zero, (n,)."""
        mean, deviation = self.predict(places)
        return ndtr(mean / np.maximum(deviation, 1e-12 * self.scale))


def fitted(places: Array, values: Array) -> Surrogate:
    """Fit a Gaussian process with a Matern kernel of its own length along each axis.

    Args:
        places: (n, d) in the unit cube.
        values: (n,) of the function, with noise.

    Raises:
        StudyError: scikit-learn is not installed.
    """
    regressor, kernels = _door()
    scale = float(np.sqrt(np.mean(values**2))) or 1.0
    smooth = kernels.ConstantKernel(1.0, (0.05, 100.0)) * kernels.Matern([0.3] * places.shape[1], LENGTHS, nu=2.5)
    noisy = smooth + kernels.WhiteKernel(1e-3, NOISE)
    process = regressor(noisy, n_restarts_optimizer=RESTARTS, random_state=0)
    with threadpool_limits(1), warnings.catch_warnings():
        # A length at its bound is an axis that does not matter.
        warnings.simplefilter("ignore")
        process.fit(places, values / scale)
        # The function without its noise: a value says where it is only as well as the noise allows.
        smooth, noise = process.kernel_.k1, float(process.kernel_.k2.noise_level)
        process = regressor(smooth, alpha=max(noise, 1e-8), optimizer=None).fit(places, values / scale)
    return Surrogate(process, scale)


def _door() -> tuple[Any, Any]:
    try:
        from sklearn.gaussian_process import GaussianProcessRegressor, kernels
    except ImportError:
        raise StudyError(
            "a boundary design needs scikit-learn, which is not installed: pip install 'heli-twin[boundary]'"
        ) from None
    return GaussianProcessRegressor, kernels


def spread_places(axes: int, log2: int, seed: int) -> Array:
    """Return 2^log2 places spread evenly over the unit cube, (n, axes)."""
    from scipy.stats import qmc

    return qmc.Sobol(axes, rng=seed).random_base2(log2)


def next_places(places: Array, values: Array, count: int, seed: int) -> Array:
    """Return the places where the sign of a function is least certain, (count, d).

    Args:
        places: (n, d) where it is known.
        values: (n,) there.
        count: How many are asked for together.
        seed: Of the candidates.
    """
    from scipy.linalg import solve_triangular

    process, scale = fitted(places, values)
    candidates = spread_places(places.shape[1], CANDIDATES_LOG2, seed)
    mean, deviation = (each / scale for each in Surrogate(process, scale).predict(candidates))
    straddle = Z95 * deviation - np.abs(mean)
    straddle[np.abs(candidates[:, None] - places).max(axis=2).min(axis=1) < NEAREST] = -np.inf
    chosen: list[int] = []
    with threadpool_limits(1):
        roots = solve_triangular(process.L_, process.kernel_(process.X_train_, candidates), lower=True)
        for _ in range(count):
            best = int(np.argmax(straddle))
            chosen.append(best)
            # A value there that is as expected leaves the mean as it is, and makes the deviation less.
            shared = process.kernel_(candidates, candidates[best : best + 1])[:, 0] - roots.T @ roots[:, best]
            row = shared / np.sqrt(deviation[best] ** 2 + process.alpha)
            less = np.sqrt(np.maximum(deviation**2 - row**2, 0.0))
            straddle += Z95 * (less - deviation)
            straddle[best] = -np.inf
            deviation, roots = less, np.vstack([roots, row])
    return candidates[chosen]


def share_above(surrogate: Surrogate, axes: int) -> Interval:
    """Return the share of the unit cube where the function is above zero, with its 95 % interval.

    The interval is twice that of functions drawn from the process at evenly spread places, all of a function together.
    It reaches one place to either side at least: nothing finer can be seen there.
    """
    places = spread_places(axes, DRAW_PLACES_LOG2, 0)
    with threadpool_limits(1):
        mean, covariance = surrogate.process.predict(places, return_cov=True)
        root = np.linalg.cholesky(covariance + 1e-7 * np.eye(len(places)))
        normal = np.random.default_rng(0).standard_normal((len(places), DRAWS))
        shares = np.mean(mean[:, None] + root @ normal > 0.0, axis=0)
    low, high = np.quantile(shares, [0.025, 0.975])
    # The places are too few for the share itself, but see how it varies.
    share = float(np.mean(surrogate.above(spread_places(axes, CANDIDATES_LOG2 + 2, 0))))
    middle, step = float(np.mean(surrogate.above(places))), 1.0 / len(places)
    below, above = max(WIDER * (middle - low), step), max(WIDER * (high - middle), step)
    low, high = max(0.0, share - below), min(1.0, share + above)
    return Interval(share, float(low), float(high), len(surrogate.process.X_train_))
