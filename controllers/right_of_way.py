"""Who makes way for whom, and on which side helicopters pass: against deadlock among plans that keep apart."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from controllers.committed_plan import CommittedPlan
from controllers.scene import Scene
from controllers.signals import Array
from controllers.wish_plan import FREE, JOINS

NEAR_M = 0.1
"""Who is nearer to where it wants to be asks nobody to step aside."""
HOME_M = 0.15
"""Who has come nearer to its wish than this has arrived, and asks for no more than what is left, if it is sent away."""
NO_PROGRESS, PROGRESS_M = 5, 0.2
"""Who has not come nearer by so much in this multiple of its patience asks too: it goes to and fro."""
RIGHT_RAD = 0.7
"""Angle, rad, by which a helicopter whose way ahead is blocked turns right; with 1.2 rad some circled for ever."""
AHEAD_M = 1.0
"""Whose plan comes ahead by less than a share of this length, or of the rest of its way, has no way ahead."""
UNHEARD = "no current plan of"
"""Beginning of the reason in the note of a turn in which news of another were missing."""
LAST = (1 << 62, "")
"""Who does not ask comes after all that do."""
ASKS_S, YIELDS_S = 1.0, 0.5
"""Durations, s, of a request after a helicopter has stood, and of a sidestep after a request."""


class Told(NamedTuple):
    """Broadcast of one planner after its newest turn: plan, goal, and whether it asks others to step aside."""

    turn: int
    """Its number, from 0; -1 before take-off."""
    plan: CommittedPlan
    goal: tuple[float, float]
    """Target at the end of the plan, world x y, m: on the wish, or where it steps aside to."""
    since: int
    """Turn in which the one for which it asks others to step aside first asked; -1 if it does not ask."""
    asker: str
    """For whom it asks: itself, or the one for which it steps aside."""
    is_down: bool
    """Its supervisor has taken over to stop or land it. The plan is to stay where it is."""
    lost: float = np.inf
    """Time of the newest picture, s, if its cameras have lost it; infinite if they see it."""

    @property
    def size(self) -> int:
        """Bytes of it on a network: knots in single precision, and thirteen further numbers."""
        return 4 * self.plan.knots.size + 52


class Manners(NamedTuple):
    """When to ask, and how far to step aside."""

    period: float
    """Between two turns, s."""
    patience: float
    """Standing this long, one asks, s."""
    distance: float
    """Promised between plans, m."""
    aside: float
    """Who is nearer than the distance and this, steps aside, m."""
    half_width: float
    """Nobody steps aside further than this from the middle of the room, m."""
    ahead: float
    """Whose plan leads on less than this share of `AHEAD_M`, or of the rest of its way, turns right."""


class Yield(NamedTuple):
    """A sidestep."""

    place: Array
    """(2,) where to, m."""
    side: float
    """On the left of the way of who asks (1), or on the right (-1)."""
    rank: tuple[int, str]
    """Turn in which the one that is made way for first asked, and its name: the lowest goes first."""
    until: int
    """Turn at which it ends, if nobody asks again."""


class RightOfWay:
    """Where one helicopter heads for, given what the others ask.

    Args:
        name: Its own.
        manners: When to ask, and how far to step aside.
    """

    def __init__(self, name: str, manners: Manners) -> None:
        self._name, self._manners = name, manners
        self._places: list[Array] = []
        """Where it was in its last turns."""
        self._asks_until = -1
        self.since = -1
        """Turn in which it first asked on this way; -1 if it has not, or has arrived."""
        self._yields: Yield | None = None
        self._goes_round: tuple[str, float] | None = None
        """Whom, and on which side."""

    def asks(self, turn: int, scene: Scene, goal: Array) -> bool:
        """Return whether it asks others to step aside from its way to a goal (2,)."""
        return turn <= self._asks_until and np.hypot(*(goal - scene.here)) >= NEAR_M

    def stands(self, turn: int, scene: Scene, goal: Array, home: Array, reason: str) -> bool:
        """Return whether it has stood, or come no nearer, for a while where it does not want to be; then it asks.

        Args:
            turn: Number of this turn.
            scene: What it knows.
            goal: (2,) where it heads for, m: on its wish, or aside.
            home: (2,) where its wish is then.
            reason: Of its last note: who flies its wish does not stand, but starts, and who waits for news asks nobody.
        """
        m, here = self._manners, scene.here
        patience = max(1, round(m.patience / m.period))
        if reason in (FREE, JOINS) or reason.startswith(UNHEARD) or np.hypot(*(goal - here)) < NEAR_M:
            self._places = []
        has_arrived = bool(np.hypot(*(home - here)) < HOME_M)
        if reason in (FREE, JOINS) or has_arrived:
            self.since = -1
        self._places = [*self._places[-NO_PROGRESS * patience :], here]
        places = np.array(self._places)
        rests = np.abs(scene.old[1:4, 1, :2]).max() < 0.03 and len(places) > patience
        stands = bool(rests and np.hypot(*(places[-patience:] - here).T).max() < 0.03)
        if len(places) > NO_PROGRESS * patience:
            stands |= bool(np.hypot(*(goal - places[0])) - np.hypot(*(goal - here)) < PROGRESS_M)
        if stands:
            # Who is sent away from where it has arrived asks for the other only.
            self.since = turn if self.since < 0 and not has_arrived else self.since
            self._asks_until = turn + round(ASKS_S / m.period)
        return stands

    def aside(self, turn: int, scene: Scene, heard: Mapping[str, Told]) -> "Yield | None":
        """Return where it steps aside to, and for whom; None if nobody asks it to.

        Args:
            turn: Number of this turn.
            scene: What it knows.
            heard: Of each other.
        """
        m = self._manners
        mine = (self.since, self._name) if self.since >= 0 and turn <= self._asks_until else LAST
        if self._yields and turn > self._yields.until:
            self._yields = None
        for j, name in enumerate(scene.names):
            told = heard[name]
            rank = (told.since, told.asker)
            if told.since < 0 or told.asker == self._name or rank > mine:
                continue
            if self._yields and self._yields.rank < rank:
                continue
            way = scene.knots[j, 1], told.goal
            ahead, sideways, _ = _seen_from(*way, scene.here)
            if ahead > 0.0 and np.hypot(ahead, sideways) < m.distance + m.aside:
                side = 1.0 if sideways > 0.01 else -1.0
                if self._yields and self._yields.rank == rank:
                    side = self._yields.side
                place = self._place_beside(*way, scene.here, side)
                self._yields = Yield(place, side, rank, turn + round(YIELDS_S / m.period))
        return self._yields

    def _place_beside(self, start: Array, goal: tuple[float, float], here: Array, side: float) -> Array:
        """Return the place (2,) beside a way: on the left (1) or right (-1), on the other side where the room ends."""
        m = self._manners
        ahead, sideways, along = _seen_from(start, goal, here)
        across = np.array([-along[1], along[0]])
        first, other = (start + ahead * along + s * max(s * sideways, m.distance + 0.1) * across for s in (side, -side))
        place = first if np.abs(first).max() <= m.half_width else other
        return np.clip(place, -m.half_width, m.half_width)

    def heading_for(self, turn: int, scene: Scene, goal: Array) -> Array:
        """Return where to head for (2,): a goal, or beside the first that stands in the way, or to the right.

        Who asks heads straight on, for those that stand there step aside, except who has landed.
        """
        asks = self.asks(turn, scene, goal)
        way = goal - scene.here
        length = max(float(np.hypot(*way)), 1e-9)
        first, shortest = None, np.inf
        for j, name in enumerate(scene.names):
            centre, radius = scene.knots[j, 1], float(scene.wide[j, 0]) + 0.05
            moves = np.abs(scene.knots[j, -1] - centre).max() >= 0.1
            steps_aside = asks and scene.wide[j, 0] <= self._manners.distance
            if moves or steps_aside or np.hypot(*(goal - centre)) <= radius - 0.05:
                continue
            ahead, sideways, _ = _seen_from(scene.here, (float(goal[0]), float(goal[1])), centre)
            if 0.0 < ahead < min(length, shortest) and abs(sideways) < radius - 0.02:
                first, shortest = (name, centre, radius, sideways), ahead
        if first is not None:
            return self._round(scene.here, length, *first)
        self._goes_round = None
        ahead = float((scene.old[-1, 0, :2] - scene.here) @ way) / length
        if asks or ahead >= self._manners.ahead * min(length, AHEAD_M):
            return goal
        # Those that move leave no way ahead: all go round each other.
        c, s = np.cos(RIGHT_RAD), np.sin(RIGHT_RAD)
        return scene.here + min(1.0, 1.0 / length) * np.array([c * way[0] + s * way[1], c * way[1] - s * way[0]])

    def _round(self, here: Array, length: float, name: str, centre: Array, radius: float, sideways: float) -> Array:
        """Return a place on the tangent to a circle about one that stands; on the same side as before."""
        side = -1.0 if sideways > -0.02 else 1.0
        if self._goes_round and self._goes_round[0] == name and abs(sideways) < 0.5 * radius:
            side = self._goes_round[1]
        self._goes_round = name, side
        there = centre - here
        apart = float(np.hypot(*there))
        angle = np.arctan2(there[1], there[0]) + side * np.arcsin(min(radius / apart, 1.0))
        return here + min(length, apart + 0.3) * np.array([np.cos(angle), np.sin(angle)])


def _seen_from(start: Array, goal: tuple[float, float], here: Array) -> tuple[float, float, Array]:
    """Return how far ahead and to the left of a way a point is, m, and the direction (2,) of the way."""
    along = np.array(goal) - start
    along /= max(float(np.hypot(*along)), 1e-9)
    x, y = here - start
    return float(x * along[0] + y * along[1]), float(y * along[0] - x * along[1]), along
