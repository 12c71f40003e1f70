"""Shared by all checks: the error of a broken rule, and comparisons that raise it."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from controllers.laws import extra_states
from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.recording.state_names import trouble_with


class NotConforming(HeliTwinError):
    """A member of a family breaks a rule of it; the message names the rule and the value that breaks it."""


def require(holds: Any, text: str) -> None:
    """Refuse a member for which something does not hold.

    Raises:
        NotConforming: It does not; the message is the text.
    """
    if not holds:
        raise NotConforming(text)


def same(one: Sequence[Array], two: Sequence[Array]) -> bool:
    """Return whether two lists of arrays are equal, NaN included."""
    return len(one) == len(two) and all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, two, strict=True))


def close(found: Array, wanted: Array, tolerance: float, text: str) -> None:
    """Refuse a member of which a number is off.

    Raises:
        NotConforming: The largest difference exceeds the tolerance.
    """
    worst = float(np.abs(found - wanted).max())
    require(worst <= tolerance, f"{text}: off by {worst:.3g}, {tolerance:g} is allowed")


def names_its_further_states(spec: Any) -> None:
    """Further states of a law or an estimator have names that a log can hold, and units."""
    states = extra_states(spec)
    trouble = trouble_with(states)
    require(not trouble, trouble)
    require(all(state.unit for state in states), "a further state has no unit: write 1 for a number without one")
