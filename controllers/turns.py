"""Times of the turns of several planners, one after the other, which all know."""

from typing import NamedTuple


class Turns(NamedTuple):
    """Rounds in which each planner has one turn, spread over the round in the order of their indices."""

    round: int
    """Duration of a round, ns."""
    step: int
    """Step of the grid of plans, ns."""
    planners: int
    """Number of planners."""

    def time(self, index: int, turn: int) -> int:
        """Return when a turn of the planner with an index is, ns."""
        return (turn * self.planners + index) * self.round // self.planners

    def departs(self, index: int, turn: int) -> int:
        """Return the index of the knot from which on a plan of a turn can be new: the next one of the grid."""
        return self.time(index, turn) // self.step + 1
