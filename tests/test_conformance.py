"""Every member of ours keeps the rules of its family, and a member that breaks one is told which."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pytest

from controllers.flatness import FlatOutput
from controllers.signals import Command
from controllers.supervisors import Order
from controllers.trajectories.hover import Hover
from heli_twin.conformance import CHECKS, verdicts
from heli_twin.experiment.families import members
from heli_twin.lab.faults import Hooks
from heli_twin.lab.plant import Air
from heli_twin.studies.designs.ladder import Ladder
from tests.own.detailed import DerivativeLaw, Everywhere, Tilted, Whirl

CASES = [
    (family, kind, check)
    for family, checks in CHECKS.items()
    for kind in members(family)
    for check in checks
    # Without a program it is no law: tests/own/test_external_laws.py checks one with a program.
    if kind != "external"
]


@pytest.mark.parametrize(
    ("family", "kind", "check"), CASES, ids=[f"{kind}-{check.__name__}" for _, kind, check in CASES]
)
def test_our_members_keep_the_rules(family: str, kind: str, check: Any) -> None:
    check(members(family)[kind]())


@pytest.mark.parametrize("check", CHECKS["heli_twin.studies.designs"], ids=lambda check: check.__name__)
def test_a_ladder_with_rungs_keeps_the_rules(check: Any) -> None:
    # Without rungs it refuses every study.
    check(Ladder(rungs=({"name": "heavier", "plant.mass": 0.03}, {"name": "late", "radio.latency": 0.01})))


@dataclass(frozen=True)
class Jerky:
    """A hover that lies about its speed and moves at the start."""

    kind: Literal["jerky"] = "jerky"

    def flat(self, t: np.ndarray) -> FlatOutput:
        flat = Hover().flat(t)
        return FlatOutput(flat.z, flat.dz + 0.1, flat.ddz)


@dataclass
class Loose:
    """Not frozen."""

    kind: Literal["loose"] = "loose"

    def flat(self, t: np.ndarray) -> FlatOutput:
        return Hover().flat(t)


def test_a_rule_that_is_broken_is_named() -> None:
    broken = {v.rule: v.trouble for v in verdicts("controllers.trajectories", Jerky) if v.trouble}
    assert list(broken) == [
        "The derivatives of its flat outputs are those of its path.",
        "It starts at rest, so that nothing jumps at the first command.",
    ]
    assert "off by 0.1" in broken["The derivatives of its flat outputs are those of its path."]
    assert any("frozen=True" in v.trouble for v in verdicts("controllers.trajectories", Loose))


def test_what_a_member_raises_is_a_verdict() -> None:
    class Broken:
        """Has nothing."""

    troubles = [v.trouble for v in verdicts("controllers.laws", Broken) if "Further states" not in v.rule]
    assert troubles
    assert all(troubles)


def broken(family: str, spec: type) -> list[str]:
    return [verdict.trouble for verdict in verdicts(family, spec) if verdict.trouble]


@pytest.mark.parametrize(
    ("family", "spec"),
    [
        ("controllers.laws", DerivativeLaw),
        ("controllers.estimators", Tilted),
        ("heli_twin.lab.faults", Everywhere),
        ("heli_twin.lab.disturbances", Whirl),
    ],
)
def test_members_that_use_the_wide_contracts_keep_the_rules(family: str, spec: type) -> None:
    assert broken(family, spec) == []


class Rough(Hover):
    """Calls a derivative continuous that jumps."""

    smoothness = 3

    def derivatives(self, t: np.ndarray, highest: int) -> np.ndarray:
        return members("controllers.trajectories")["circle"]().derivatives(t, highest)

    def flat(self, t: np.ndarray) -> FlatOutput:
        return FlatOutput(*self.derivatives(t, 2))


class Wrong(Rough):
    """Its fourth derivative is not the slope of its third."""

    smoothness = 2

    def derivatives(self, t: np.ndarray, highest: int) -> np.ndarray:
        found = super().derivatives(t, highest)
        found[4:] *= 1.1
        return found


@pytest.mark.parametrize(
    ("spec", "text"), [(Rough, "derivative 3 jumps"), (Wrong, "derivative 4 is not the slope of derivative 3")]
)
def test_a_wrong_higher_derivative_is_found(spec: type, text: str) -> None:
    assert [trouble for trouble in broken("controllers.trajectories", spec) if text in trouble]


def _hooks(**hooks: Any) -> type:
    @dataclass(frozen=True)
    class Bad:
        """A fault of a test."""

        kind: Literal["bad"] = "bad"

        def hooks(self, rng: np.random.Generator) -> Any:
            return Hooks(**hooks)

    return Bad


def _shaken(t: int, u: np.ndarray, truth: object) -> np.ndarray:
    u += 0.1
    return u


CALLS = iter(range(10**9))


@pytest.mark.parametrize(
    ("hooks", "text"),
    [
        ({}, "no hook"),
        ({"pose": lambda arrival: arrival.pose}, "pose has to return an Arrival"),
        ({"estimate": lambda t, estimate: estimate._replace(stamp=0)}, "for the same time"),
        ({"command": lambda t, command: [(t - 1, command)]}, "ready at"),
        ({"command": lambda t, command: command}, "a list of times"),
        ({"latency": lambda t, latency: -1}, "at least 0"),
        ({"received": lambda t, held: held.u}, "received has to return a Held"),
        ({"input": lambda t, u, truth: u * np.nan}, "four finite inputs"),
        ({"input": _shaken}, "changes what the hook input is given"),
        ({"gyro": lambda t: None}, "whether it works"),
        ({"battery": lambda t, battery: 3.7}, "a Battery"),
        ({"latency": lambda t, latency: next(CALLS)}, "the same seed broke something else"),
    ],
)
def test_a_fault_that_breaks_more_than_its_wire_is_told_so(hooks: dict[str, Any], text: str) -> None:
    assert [trouble for trouble in broken("heli_twin.lab.faults", _hooks(**hooks)) if text in trouble]


class Idle:
    """A supervisor that orders nothing, or too much."""

    phase = "flying"
    command: Any = None

    def battery(self, voltage: float) -> None: ...

    def sent(self, command: Command) -> None: ...

    def order(self, now: int, estimate: Any, plan: Any) -> Order:
        return Order(command=self.command)


def _supervised(phase: str = "flying", u: Any = None) -> type:
    @dataclass(frozen=True)
    class Bad:
        """A supervisor of a test."""

        kind: Literal["bad"] = "bad"

        def start(self, model: Any, period: float) -> Idle:
            supervisor = Idle()
            supervisor.phase, supervisor.command = phase, None if u is None else Command(0, np.array(u))
            return supervisor

    return Bad


@pytest.mark.parametrize(
    ("spec", "text"),
    [
        (_supervised(), "neither a reference nor a command"),
        (_supervised(u=[0, 0, 2, 0]), "not four inputs in full stick"),
        (_supervised(u=[0, 0, 0.5, 0]), "something else than the plan"),
        (_supervised("lost"), "its phase is 'lost'"),
    ],
)
def test_a_supervisor_that_does_not_order_is_told_so(spec: type, text: str) -> None:
    assert [trouble for trouble in broken("controllers.supervisors", spec) if text in trouble]


@dataclass(frozen=True)
class Nameless(Tilted):
    """Estimates with a state less than it names."""

    kind: Literal["nameless"] = "nameless"
    extra_states = (("roll", "rad"), ("pitch", "rad"), ("third", "rad"))


def test_a_state_without_its_name_is_found() -> None:
    assert "names 3" in " ".join(broken("controllers.estimators", Nameless))


@dataclass(frozen=True)
class Torn(Whirl):
    """A moment that is not finite."""

    kind: Literal["torn"] = "torn"

    def air(self, truth: Any, others: np.ndarray) -> Air:
        return Air(np.zeros(3), np.zeros(3), 1.0, np.array([0, 0, np.inf]))


def test_a_moment_that_is_not_finite_is_found() -> None:
    assert "the air is" in " ".join(broken("heli_twin.lab.disturbances", Torn))
