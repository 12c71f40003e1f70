"""Names and units of what an estimator or a law has beyond the physical states, as a log's metadata hold them."""

import json
import re
from collections.abc import Iterable, Sequence

from controllers.signals import NamedState
from heli_twin.terminal_text import clean

EXTRA_STATES = {"/estimate_extra": "extra_states.estimate", "/mpc/plan_extra": "extra_states.plan"}
"""Key of the metadata that name the states of a topic: JSON, a list of pairs of name and unit."""
MAX_STATES = 200
"""Most further states of a log."""
_NAME = re.compile("(?!(time|stamp|state_[0-9]+|.*_variance)$)[a-z][a-z0-9_]{0,39}")
"""A name of a state; those that it leaves out are names of other columns."""


def names_of(states: Iterable[NamedState]) -> str:
    """Return names and units as metadata hold them."""
    return json.dumps([list(state) for state in states])


def named(text: str, count: int) -> tuple[NamedState, ...]:
    """Return the names and units of `count` states from metadata; others than such names become `state_0` and so on."""
    try:
        pairs = json.loads(text[:100_000]) if text else []
    except (ValueError, RecursionError):
        pairs = []
    states: list[NamedState] = []
    for i in range(count):
        pair = pairs[i] if isinstance(pairs, list) and i < len(pairs) else ()
        name, unit = map(str, pair) if isinstance(pair, list) and len(pair) == 2 else ("", "")
        is_name = _NAME.fullmatch(name) and name not in {state.name for state in states}
        states.append(NamedState(name if is_name else f"state_{i}", clean(unit, 20)))
    return tuple(states)


def trouble_with(states: Sequence[NamedState]) -> str:
    """Return why a log cannot hold states of these names, one sentence; empty if it can."""
    names = [state.name for state in states]
    if len(states) > MAX_STATES:
        return f"extra_states has {len(states)} states: {MAX_STATES} at most are recorded"
    bad = next((name for name in names if not _NAME.fullmatch(name)), None)
    if bad is not None:
        return (
            f"extra_states has the name '{clean(bad, 60)}': use lower-case letters, digits and _, such as tilt_x; time,"
            " stamp and what ends in _variance are names of other columns"
        )
    twice = next((name for name in names if names.count(name) > 1), None)
    return f"extra_states has the name '{twice}' twice: give each state a name of its own" if twice else ""
