"""A ladder: one effect of the real world more at each rung, so that each has its share of the error."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import doc

from heli_twin.studies.designs import Batches, Point
from heli_twin.studies.errors import StudyError
from heli_twin.studies.space import Space, experiments_of, varied


@dataclass(frozen=True, slots=True)
class Ladder:
    """The base, and then one rung after another; each rung keeps the changes of those below it."""

    adaptive: ClassVar[bool] = False
    kind: Literal["ladder"] = "ladder"
    ground: Annotated[str, doc("what the base is called")] = "base"
    rungs: Annotated[
        tuple[dict[str, Any], ...],
        doc("from below: `name`, and the changes it makes, such as `plant.servo_lag = 0.03`"),
    ] = ()

    def check(self, space: Space) -> None:
        """Refuse rungs with equal names or changes that cannot be flown, and axes."""
        if not self.rungs:
            raise StudyError("a ladder needs rungs: add [[design.rungs]] with a name and the changes it makes")
        if space.axes:
            raise StudyError("a ladder goes up its rungs alone: take [axes] away, or another design")
        for number, rung in enumerate(self.rungs, 1):
            if not isinstance(rung.get("name"), str) or len(rung) < 2:
                raise StudyError(f"rung {number} of the ladder needs a name and at least one change")
        names = [self.ground, *(rung["name"] for rung in self.rungs)]
        if len(set(names)) < len(names):
            raise StudyError("two rungs of the ladder have the same name")
        for alternative in space.alternatives:
            for point in self._points():
                experiments_of(varied(space.base, alternative.changes | point.changes))

    def count(self, space: Space) -> int:
        """The base and every rung."""
        return space.runs(1 + len(self.rungs))

    def batches(self, space: Space) -> Batches:
        """Yield one batch, the lowest rung first."""
        yield self._points()

    def _points(self) -> Iterator[Point]:
        changes: dict[str, Any] = {}
        yield Point({}, {"rung": self.ground, "height": 0})
        for height, rung in enumerate(self.rungs, 1):
            for path, value in _leaves({k: v for k, v in rung.items() if k != "name"}):
                changes.pop(path, None)
                changes[path] = value
            yield Point(dict(changes), {"rung": rung["name"], "height": height})


def _leaves(tree: dict[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    """Every value with its dotted path, kinds first."""
    for key, value in sorted(tree.items(), key=lambda item: item[0] != "kind"):
        if isinstance(value, dict):
            yield from _leaves(value, f"{path}{key}.")
        else:
            yield f"{path}{key}", value
