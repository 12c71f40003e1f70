import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers import linear_equation
from controllers.linear_equation import _with_checks, solve


@given(st.integers(0, 2**32 - 1), st.integers(1, 80))
def test_it_solves_to_the_last_digit_as_numpy_does(seed, n):
    rng = np.random.default_rng(seed)
    A, b = rng.standard_normal((n, n)), rng.standard_normal(n)
    np.testing.assert_array_equal(solve(A, b), np.linalg.solve(A, b))


@pytest.mark.parametrize("way", [solve, _with_checks])
def test_a_singular_equation_has_no_solution(way):
    with np.errstate(all="ignore"):
        assert np.isnan(way(np.ones((2, 2)), np.ones(2))).all()


def test_numpy_has_it_still():
    """Without it every flight is slower, and no number changes."""
    assert solve is not _with_checks
    assert linear_equation._inside is not None
