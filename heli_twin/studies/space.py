"""The space of a design: base experiment, alternatives, axes and seeds."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from heli_twin.experiment.own import refuse_commands
from heli_twin.experiment.text import put_part
from heli_twin.experiment.tree import Tree, parsed
from heli_twin.studies.axes import Axis


class Alternative(NamedTuple):
    """One of the compared experiments."""

    name: str
    changes: dict[str, Any]
    """Its changes of the base: values by dotted path."""


@dataclass(frozen=True, slots=True)
class Space:
    """The space in which a design places its points."""

    base: str
    """The base experiment, canonical JSON."""
    alternatives: tuple[Alternative, ...]
    axes: Mapping[str, Axis]
    """The axes by the path of the field that each varies."""
    seeds: range
    """The seeds of every point; designs that draw points use the first of them."""
    score: str
    """The metric that ranks flights, smaller is better."""
    penalty: float
    """The score of a flight that failed."""
    requirements: tuple[str, ...] = ()
    """Names of the study's requirements."""

    def runs(self, points: int) -> int:
        """Return the number of runs of so many points."""
        return points * len(self.alternatives) * len(self.seeds)


def varied(base: str, changes: Mapping[str, Any]) -> Tree:
    """An experiment with some fields changed, one after the other.

    Args:
        base: Canonical JSON.
        changes: Values by dotted path.
    """
    tree = parsed(base)
    for path, value in changes.items():
        # A linspace over a horizon gives 12.0 and 13.5.
        counts = type(value_at(tree, path)) is int and isinstance(value, float)
        put_part(tree, path, round(value) if counts else value)
    refuse_commands(tree)
    return tree


def value_at(tree: Tree, path: str) -> Any:
    """The value at a dotted path; None where there is none yet."""
    value: Any = tree
    for key in path.split("."):
        value = value.get(key) if isinstance(value, dict) else None
    return value
