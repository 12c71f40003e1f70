"""Every member of ours keeps the rules of its family, and a member that breaks one is told which."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pytest

from controllers.flatness import FlatOutput
from controllers.trajectories.hover import Hover
from heli_twin.conformance import CHECKS, verdicts
from heli_twin.experiment.families import members

CASES = [(family, kind, check) for family, checks in CHECKS.items() for kind in members(family) for check in checks]


@pytest.mark.parametrize(
    ("family", "kind", "check"), CASES, ids=[f"{kind}-{check.__name__}" for _, kind, check in CASES]
)
def test_our_members_keep_the_rules(family: str, kind: str, check: Any) -> None:
    check(members(family)[kind]())


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

    assert all(v.trouble for v in verdicts("controllers.laws", Broken))
