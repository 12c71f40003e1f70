"""One linear equation in a control step, by LAPACK alone.

`numpy.linalg.solve` looks at its arguments for as long as LAPACK takes for an equation of some forty unknowns: a
twentieth of a flight. This is the function that it calls in the end.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from controllers.signals import Array

_inside: Any = getattr(np.linalg, "_umath_linalg", None)
"""NumPy's own room for LAPACK, which it may move some day."""


def _with_checks(A: Array, b: Array) -> Array:
    """Return x of A x = b by NumPy's public function; NaN if A is singular."""
    try:
        return np.asarray(np.linalg.solve(A, b), np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(b, np.nan)


solve: Callable[[Array, Array], Array] = getattr(_inside, "solve1", _with_checks)
"""Returns x (n,) of A x = b for A (n, n) and b (n,), both of float64; NaN if A is singular."""
