from types import SimpleNamespace

import numpy as np
import pytest

from controllers.model import GRAVITY
from heli_twin.identification.data import ROW_S
from heli_twin.identification.figure import SHOWN_S, residual_figures
from heli_twin.identification.fit import MEMORY_S

N = 400
"""Rows of a piece of flight: 40 s."""
TIME = 5.0 + ROW_S * np.arange(N)
RESIDUAL = 0.3 * (-1.0) ** np.arange(N)
ACCEL = np.sin(TIME)


def panels(axis):
    """The panels of a fit of two pieces, with residuals that alternate between 0.3 and -0.3."""
    fit = SimpleNamespace(
        time=(TIME, TIME + 100.0), accel=(ACCEL,) * 2, residual=(RESIDUAL,) * 2, explained=0.75, residual_rms=0.3
    )
    (figure,) = residual_figures(SimpleNamespace(fits={axis: fit}))
    return figure.panels


@pytest.mark.parametrize(("axis", "weight"), [("x", 0.0), ("z", GRAVITY)])
def test_what_is_explained_is_what_was_measured_less_the_residual(axis, weight):
    fitted, residual, *_ = panels(axis)
    measured, explained = fitted.marks
    shown = round(SHOWN_S / ROW_S)
    np.testing.assert_allclose(measured.x, TIME[:shown])
    np.testing.assert_allclose(measured.y, ACCEL[:shown] - weight, atol=1e-12)
    np.testing.assert_allclose(explained.y, measured.y - RESIDUAL[:shown], atol=1e-12)
    np.testing.assert_array_equal(residual.marks[0].y, RESIDUAL[:shown])
    assert "75.0 %" in fitted.title


def test_the_distributions_have_an_area_of_one_and_the_same_spread():
    density, normal = panels("x")[2].marks
    # 40 bins of 0.06 within 4 rms; half of the values lie at each of -0.3 and 0.3.
    assert density.y.sum() * 0.06 == pytest.approx(1.0)
    # The values lie on edges of bins.
    np.testing.assert_allclose(np.abs(density.x[density.y > 0]), 0.3, atol=0.0301)
    assert (normal.x[0], normal.x[-1]) == pytest.approx((-1.2, 1.2))
    assert normal.y.max() == pytest.approx(1.0 / (0.3 * np.sqrt(2 * np.pi)))
    # Four deviations on either side hold all but 6e-5 of it.
    step = normal.x[1] - normal.x[0]
    assert normal.y.sum() * step == pytest.approx(1.0, abs=1e-4)
    assert (normal.x**2 * normal.y).sum() * step == pytest.approx(0.09, rel=2e-3)


def test_an_alternating_residual_has_an_alternating_correlation():
    residual, noise = panels("x")[3].marks
    lags = np.arange(round(2 * MEMORY_S / ROW_S))
    np.testing.assert_allclose(residual.x, ROW_S * lags, atol=1e-12)
    np.testing.assert_allclose(residual.y, (-1.0) ** lags * (N - lags) / N, atol=1e-12)
    # The 95 % band of white noise, of all 800 rows.
    np.testing.assert_allclose(noise.high, 1.96 / np.sqrt(2 * N), rtol=1e-12)
    np.testing.assert_allclose(noise.low, -noise.high)
