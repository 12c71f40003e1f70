import gc
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import numpy as np
import pytest
from hypothesis import settings
from scipy.optimize import nnls
from threadpoolctl import threadpool_limits

from controllers.model import Model
from heli_twin.experiment.past import PAST, PHYSICS_VERSION, Past
from heli_twin.studies.study import Study, study_of

pytest_plugins = ["plausible_flight"]

settings.register_profile("ci", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("ci")
# Matrices of this size are slower on many threads, and tests share the machine.
threadpool_limits(1)
# Libraries and tests make 400 000 objects that stay: to look through them again and again takes a quarter of the
# collection of the tests.
gc.set_threshold(10_000, 10, 10)
# Worker processes load what they run by its name.
sys.path.insert(0, str(Path(__file__).parent))


def pytest_collection_finish() -> None:
    """Leave the objects that stay out of later garbage collections."""
    gc.freeze()


@pytest.fixture
def rise_version(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Raise the physics version and change a default: the believed limit of the yaw input."""

    def rise() -> None:
        for room in ("past", "paths", "toml_file"):
            monkeypatch.setattr(f"heli_twin.experiment.{room}.PHYSICS_VERSION", PHYSICS_VERSION + 1)
        past = Past(PHYSICS_VERSION + 1, Model().u_yaw_max, is_new=False)
        monkeypatch.setitem(PAST, "controllers.model.Model.u_yaw_max", past)
        *others, _ = Model.__init__.__defaults__ or ()
        monkeypatch.setattr(Model.__init__, "__defaults__", (*others, 0.5))
        assert Model().u_yaw_max == 0.5

    return rise


class QpSolver(Protocol):
    def __call__(self, H: np.ndarray, g: np.ndarray, A: np.ndarray, b: np.ndarray) -> np.ndarray: ...


@pytest.fixture(scope="session")
def minimiser() -> QpSolver:
    """A QP solver with nothing in common with the ground station's: exact, and slow."""

    def minimiser(H: np.ndarray, g: np.ndarray, A: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Minimise 1/2 u'H u + g'u subject to A u <= b, as the least distance problem it is in y = L'u + L^-1 g.

        Source: Lawson, Hanson, Solving Least Squares Problems, chapter 23.
        """
        finite = np.isfinite(b)
        L = np.linalg.cholesky(H)
        middle = np.linalg.solve(L, g)
        rows = -np.linalg.solve(L, A[finite].T).T
        offset = rows @ middle - b[finite]
        stacked = np.vstack([rows.T, offset])
        goal = np.append(np.zeros(len(g)), 1.0)
        multipliers, _ = nnls(stacked, goal, maxiter=100 * len(goal))
        r = stacked @ multipliers - goal
        if np.abs(r).max() < 1e-10:
            raise ValueError("no point satisfies all bounds")
        return np.linalg.solve(L.T, -r[:-1] / r[-1] - middle)

    return minimiser


@pytest.fixture(scope="session")
def small() -> Study:
    """Six flights of a moment each, of the ideal helicopter with a gust."""
    return study_of(
        {
            "name": "small",
            "base": {"preset": "ideal", "duration": 2.6, "disturbances": {"gust": "on"}},
            "axes": {"disturbances.gust.strength": [0.1, 0.3, 0.5]},
            "replicates": 2,
            "logs": {"worst": 1, "sampled": 0},
        }
    )
