"""Verdicts: whether a flight keeps its requirements, by how much, and when it comes nearest to breaking one."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.recording import Log
from heli_twin.requirements.file import Requirement
from heli_twin.requirements.formula import Below, Formula, Holds, Scale, Tightest, Trace
from heli_twin.requirements.signals import trace_of
from heli_twin.requirements.units import converted


@dataclass(frozen=True)
class Verdict:
    """How a flight stands to one requirement."""

    requirement: Requirement
    holds: bool
    margin: float | None
    """In `unit`: how much nearer the tightest signal may come to its limit; negative if it is broken. None if the
    requirement is decided by what is true or false alone."""
    unit: str | None
    """Unit of the signal that decides: m, rad, m/s, rad/s, ms, V or none."""
    normalised: float | None
    """The margin divided by the limit of the signal that decides; by one unit if the limit is 0."""
    tightest_at: float | None
    """When that is, s."""
    reason: str
    """The signal that decides, and its value then."""
    margin_text: str = ""
    """The margin as a person reads it, in the unit of the formula."""
    decides: Below | Holds | None = None
    """The part of the formula that decides."""

    @property
    def told(self) -> str:
        """The verdict in a few words."""
        if self.margin is None:
            return "holds" if self.holds else "broken"
        return f"margin {self.margin_text}" if self.holds else f"broken by {self.margin_text.removeprefix('-')}"

    def plain(self) -> dict[str, Any]:
        """Return the verdict as values for JSON."""
        return {
            "holds": self.holds,
            "margin": self.margin,
            "unit": self.unit,
            "normalised": self.normalised,
            "tightest_at": self.tightest_at,
            "formula": self.requirement.formula,
            "reason": self.reason,
        }


def judge(requirements: Iterable[Requirement], log: Log) -> dict[str, Verdict]:
    """Judge a flight.

    A requirement that looks at times after the end of the flight only is not kept: nothing shows that it is.

    Args:
        requirements: What it must do.
        log: The flight; an imported one too, as far as it holds the signals.

    Returns:
        The verdict on each requirement, by name; of several helicopters that on each of them, as `a: NAME`.

    Raises:
        HeliTwinError: The log does not hold a signal.
    """
    requirements = tuple(requirements)
    if log.ships:
        of_each = {ship: judge(requirements, log.ship(ship)) for ship in log.ships}
        return {f"{ship}: {name}": verdict for ship, each in of_each.items() for name, verdict in each.items()}
    leaves = {requirement.name: list(requirement.parsed.leaves()) for requirement in requirements}
    trace = trace_of(log, {name for each in leaves.values() for leaf in each for name in leaf.signals()})
    start = _start(log)
    return {requirement.name: _verdict(requirement, trace, start) for requirement in requirements}


def margin_change(before: Verdict, now: Verdict) -> str:
    """Return how the margin changed, as a person reads it; empty if the two margins cannot be compared."""
    if before.margin is None or now.margin is None or before.unit != now.unit or not isinstance(now.decides, Below):
        return ""
    change = shown(now.margin - before.margin, now.decides)
    return change if change.startswith("-") else f"+{change}"


class Decisive(NamedTuple):
    """The signals that decide about a requirement, over the whole flight."""

    time: Array
    """(n,) s."""
    signals: Mapping[str, Array]
    """(n,) each, in `unit`; 1 and 0 for true and false."""
    limit: float | None
    """In `unit`; None if two signals are compared, or one that is true or false."""
    unit: str


def decisive(verdict: Verdict, log: Log) -> Decisive | None:
    """Return the signals that decide about a verdict, in the unit that the limit was written with.

    Args:
        verdict: On this log.
        log: The flight.

    Returns:
        None where there was nothing to look at.
    """
    leaf = verdict.decides
    if leaf is None:
        return None
    trace = trace_of(log, set(leaf.signals()))
    time = _start(log) + trace.period * np.arange(trace.length, dtype=np.float64)
    if not isinstance(leaf, Below):
        return Decisive(time, {leaf.signal: np.asarray(trace.signals[leaf.signal], np.float64)}, None, "")
    factor = converted(1.0, leaf.unit, leaf.shown_unit)
    sides = {side.signal: np.asarray(factor * side.value(trace)) for side in (leaf.low, leaf.high) if side.signal}
    number = next((side.number for side in (leaf.low, leaf.high) if not side.signal), None)
    return Decisive(time, sides, None if number is None else factor * number, leaf.shown_unit)


def _start(log: Log) -> float:
    """The first sample's time, s."""
    return 1e-9 * float(log.truth.time[0] if len(log.truth.time) else log.pose.stamp.min())


def _verdict(requirement: Requirement, trace: Trace, start: float) -> Verdict:
    formula = requirement.parsed
    scale = _scale(formula)
    value = float(formula.robustness(trace, scale)[0])
    decides = formula.tightest(0, trace, scale)
    if decides is None:
        lasts = (trace.length - 1) * trace.period
        return Verdict(requirement, False, None, None, None, None, f"the flight lasts {lasts:g} s: nothing to look at")
    at, leaf = start + decides.sample * trace.period, decides.leaf
    holds = value >= 0.0
    if not isinstance(leaf, Below) or not np.isfinite(value):
        return Verdict(requirement, holds, None, None, None, at, _reason(decides, trace), decides=leaf)
    margin = value * scale(leaf)
    normalised, text = margin / leaf.limit, shown(margin, leaf)
    return Verdict(requirement, holds, margin, leaf.unit, normalised, at, _reason(decides, trace), text, leaf)


def _scale(formula: Formula) -> Scale:
    """Return the divisor of each comparison: its limit if they are of several units, else none."""
    units = {leaf.unit for leaf in formula.leaves() if isinstance(leaf, Below)}
    return (lambda leaf: leaf.limit) if len(units) > 1 else (lambda _: 1.0)


def _reason(decides: Tightest, trace: Trace) -> str:
    at, leaf = decides
    if not isinstance(leaf, Below):
        return f"{leaf.signal} is {'true' if trace.signals[leaf.signal][at] else 'false'}"
    return ", ".join(f"{name} is {shown(float(trace.signals[name][at]), leaf)}" for name in leaf.signals())


def shown(value: float, leaf: Below) -> str:
    """Return a value of the signals of a comparison in the unit that the comparison was written with."""
    return f"{converted(value, leaf.unit, leaf.shown_unit):.4g} {leaf.shown_unit}".strip()
