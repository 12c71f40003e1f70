"""Conformance: what every member of a family has to keep, ours and a stranger's alike.

A check is a function of a member as a value; it returns nothing, or raises `NotConforming` with one sentence. Use them
in a test suite of your own:

    from heli_twin.conformance import CHECKS
    @pytest.mark.parametrize("check", CHECKS["controllers.laws"], ids=lambda check: check.__name__)
    def test_my_law(check):
        check(MyLaw())
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import FrozenInstanceError, fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from controllers.flatness import feed_forward, state
from controllers.model import Model
from controllers.reference import ReferencePreview, check_feasible
from controllers.signals import Array, Command, Estimate, Pose, Reference, nanoseconds
from controllers.trajectories import fitted
from controllers.trajectories.hover import Hover
from heli_twin.errors import HeliTwinError
from heli_twin.lab.disturbances import PERIOD_NS
from heli_twin.lab.plant import STILL_AIR, Air
from heli_twin.lab.plant.ideal import Ideal

MODEL = Model()


class NotConforming(HeliTwinError):
    """A member of a family breaks a rule of it; the message names the rule and the value that breaks it."""


class Verdict(NamedTuple):
    """The outcome of one check."""

    rule: str
    trouble: str
    """The reason why it does not hold, one sentence; empty where it holds."""


def verdicts(family: str, spec: type) -> Iterator[Verdict]:
    """Run every check of a family on a member with its defaults; what a member raises is a verdict too.

    Args:
        family: Package of the family; one without checks of its own gets those of every value.
        spec: Class of the member.
    """
    for check in CHECKS.get(family, (is_a_frozen_value,)):
        rule = (check.__doc__ or check.__name__).partition("\n")[0]
        try:
            check(spec())
        except NotConforming as error:
            yield Verdict(rule, str(error))
        except Exception as error:
            yield Verdict(rule, f"it raised {type(error).__name__}: {error}")
        else:
            yield Verdict(rule, "")


def _require(holds: Any, text: str) -> None:
    if not holds:
        raise NotConforming(text)


def _same(one: Sequence[Array], two: Sequence[Array]) -> bool:
    return len(one) == len(two) and all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, two, strict=True))


def is_a_frozen_value(member: Any) -> None:
    """It is a frozen dataclass whose first field is its kind, equal to another of the same fields, and hashable."""
    spec = type(member)
    _require(is_dataclass(member), f"{spec.__name__} is no dataclass: write @dataclass(frozen=True)")
    _require(fields(member)[0].name == "kind", f"the first field of {spec.__name__} has to be kind")
    try:
        member.kind = member.kind
    except FrozenInstanceError:
        pass
    else:
        raise NotConforming(f"{spec.__name__} can be changed: write @dataclass(frozen=True)")
    _require(spec() == spec() and hash(spec()) == hash(spec()), f"two {spec.__name__}() are not equal")
    _require(spec.__doc__, f"{spec.__name__} has no docstring: say in a sentence what it is")


_STEP_S = 1e-4
_TIMES_S = np.arange(_STEP_S, 40.0, 0.0137)


def _slope(values: Callable[[Array], Array]) -> Array:
    """Central difference of a function of time."""
    return (values(_TIMES_S + _STEP_S) - values(_TIMES_S - _STEP_S)) / (2.0 * _STEP_S)


def _close(found: Array, wanted: Array, tolerance: float, text: str) -> None:
    worst = float(np.abs(found - wanted).max())
    _require(worst <= tolerance, f"{text}: off by {worst:.3g}, {tolerance:g} is allowed")


def has_true_derivatives(trajectory: Any) -> None:
    """The derivatives of its flat outputs are those of its path."""
    flat = fitted(trajectory, MODEL).flat
    # Half the step squared times the third derivative (below 50 in a room) is 3e-7; where that one jumps, at the end
    # of a ramp, the step times the jump: 1e-3 at most.
    _close(_slope(lambda t: flat(t).z), flat(_TIMES_S).dz, 1e-6, "dz is not the derivative of z")
    _close(_slope(lambda t: flat(t).dz), flat(_TIMES_S).ddz, 1e-3, "ddz is not the derivative of dz")


def can_be_flown_in_the_room(trajectory: Any) -> None:
    """The believed helicopter can fly it for a minute."""
    check_feasible(trajectory, MODEL, 60.0, 0.02)


def starts_at_rest(trajectory: Any) -> None:
    """It starts at rest, so that nothing jumps at the first command."""
    flat = fitted(trajectory, MODEL).flat(np.zeros(1))
    _close(flat.dz, np.zeros((1, 4)), 0.0, "it moves at time 0")
    _close(feed_forward(MODEL, flat)[0], np.array(MODEL.u_hover), 1e-12, "its first input is no hover")


def is_finite_and_above_the_floor(trajectory: Any) -> None:
    """At every time from 0 to 10 hours it has a finite point above the floor."""
    t = np.concatenate([[0.0], np.geomspace(1e-9, 36_000.0, 2000)])
    flat = fitted(trajectory, MODEL).flat(t)
    for name, values in zip(("z", "dz", "ddz"), flat, strict=False):
        _require(values.shape == (len(t), 4), f"{name} has shape {values.shape}, not ({len(t)}, 4)")
        _require(np.isfinite(values).all(), f"{name} is not finite at some time")
    _require((flat.z[:, 2] > 0.0).all(), f"it goes down to {flat.z[:, 2].min():.3g} m")


def is_a_function_of_time(trajectory: Any) -> None:
    """A point does not depend on which others are asked for."""
    flat, t = fitted(trajectory, MODEL).flat, np.linspace(0.0, 40.0, 101)
    together = flat(t)
    for i in (0, 37, 100):
        # Vectorised sines may differ in their last digit.
        _close(flat(t[i : i + 1]).z[0], together.z[i], 1e-12, "z depends on the other times")
        _close(flat(t[i : i + 1]).ddz[0], together.ddz[i], 1e-9, "ddz depends on the other times")


def _hover_steps(law: Any, count: int = 40) -> tuple[list[Array], list[tuple[Estimate, Reference]]]:
    """The commands of a law in a hover that it is pushed out of, and what it was given."""
    period = nanoseconds(law.period)
    preview = ReferencePreview(Hover(), law.model, period, 0)
    plant = Ideal(step=law.period).start(state(Hover().flat(np.zeros(1)))[0])
    controller, sent, given = law.start(), [], []
    for k in range(count):
        now = k * period
        truth = plant.truth()
        c, s = np.cos(truth.yaw), np.sin(truth.yaw)
        vx, vy, vz = truth.velocity
        x = np.array([*truth.position, truth.yaw, c * vx + s * vy, c * vy - s * vx, vz, truth.yaw_rate])
        estimate = Estimate(now, x, np.zeros(4), np.full((4, 3), 1e-4), now, 0)
        reference = preview(now, law.steps)
        command = controller.explain(controller.step(now, estimate, reference))
        sent.append(np.array(command.u))
        given.append((estimate, reference))
        plant.advance(now + period, np.clip(command.u, -1, 1), Air(np.zeros(3), np.array([0.3, -0.2, 0.1])))
    return sent, given


def says_its_period_and_model(law: Any) -> None:
    """It has a positive period, a whole number of steps, and a believed model."""
    _require(0.0 < law.period <= 1.0, f"period = {law.period} s: it has to be above 0 and at most 1 s")
    _require(
        isinstance(law.steps, int) and law.steps >= 1, f"steps = {law.steps}: it has to be a whole number from 1 on"
    )
    _require(isinstance(law.model, Model), "model has to be a controllers.model.Model")


def sends_finite_inputs(law: Any) -> None:
    """Every command is four finite inputs within full stick, decided at the control time."""
    for u in _hover_steps(law)[0]:
        _require(u.shape == (4,), f"a command has shape {u.shape}, not (4,)")
        _require(np.isfinite(u).all(), f"a command is {u.tolist()}")
        _require((np.abs(u) <= 1.0).all(), f"a command is {u.tolist()}: full stick is 1")


def is_deterministic(law: Any) -> None:
    """Two flights of one value are equal, and do not share a state."""
    first, second = _hover_steps(law)[0], _hover_steps(law)[0]
    _require(_same(first, second), "the same flight gave other commands: start() has to make a new controller")


def leaves_its_inputs_alone(law: Any) -> None:
    """It does not change the estimate and the reference that it is given."""
    period = nanoseconds(law.period)
    preview = ReferencePreview(Hover(), law.model, period, 0)
    for estimate, reference in _hover_steps(law, 3)[1]:
        fresh = preview(estimate.stamp, law.steps)
        _require(
            np.array_equal(reference.x, fresh.x) and np.array_equal(reference.u, fresh.u), "the reference was changed"
        )


def _poses(count: int, period: int = 5_000_000) -> Iterator[tuple[int, Pose]]:
    for k in range(count):
        t = k * period
        position = np.array([0.1 * np.sin(1e-9 * t), 0.1 - 0.1 * np.cos(1e-9 * t), 1.0])
        yield t + 10_000_000, Pose(t, position, np.array([1.0, 0.0, 0.0, 0.0]))


def _estimates(spec: Any, poses: Sequence[tuple[int, Pose]]) -> list[Estimate | None]:
    estimator, estimates = spec.start(MODEL), []
    for k, (at, pose) in enumerate(poses):
        estimator.receive(at, pose)
        if k % 4 == 3:
            estimates.append(estimator.estimate(at))
            estimator.command_sent(at, np.array(MODEL.u_hover))
    return estimates


def knows_nothing_before_the_first_pose(spec: Any) -> None:
    """Before the first pose its estimate is None."""
    _require(spec.start(MODEL).estimate(0) is None, "it has an estimate without a pose")


def follows_the_poses(spec: Any) -> None:
    """Without noise it follows a slow circle within 5 cm and 10 cm/s, with finite numbers."""
    poses = list(_poses(800))
    last = _estimates(spec, poses)[-1]
    _require(last is not None, "it has no estimate after 4 s of poses")
    assert last is not None
    t = 1e-9 * last.stamp
    wanted = np.array([0.1 * np.sin(t), 0.1 - 0.1 * np.cos(t), 1.0, 0.0, 0.1 * np.cos(t), 0.1 * np.sin(t), 0.0, 0.0])
    _require(last.x.shape == (8,) and np.isfinite(last.x).all(), f"its state is {last.x.tolist()}")
    _close(last.x[:4], wanted[:4], 0.05, "position and yaw")
    _close(last.x[4:], wanted[4:], 0.1, "velocity")


def survives_nonsense(spec: Any) -> None:
    """Poses that are not finite, late or twice change nothing into NaN."""
    poses = list(_poses(400))
    bad = [
        (at, Pose(p.stamp, np.full(3, np.nan), np.full(4, np.nan))) if i % 7 == 3 else (at, p)
        for i, (at, p) in enumerate(poses)
    ]
    bad[100:100] = [bad[50], bad[99]]
    bad.sort(key=lambda row: row[0])
    last = _estimates(spec, bad)[-1]
    _require(last is not None and np.isfinite(last.x).all(), "its estimate is not finite any more")


def estimates_are_repeatable(spec: Any) -> None:
    """Two flights of one value are equal."""
    poses = list(_poses(200))
    first, second = _estimates(spec, poses), _estimates(spec, poses)
    _require(_same([e.x for e in first if e], [e.x for e in second if e]), "the same poses gave another estimate")


def excites_within_the_limits(spec: Any) -> None:
    """It adds the same finite inputs every time it is asked, and the sum keeps the limits of the inputs."""
    for k in range(200):
        command = Command(k * 20_000_000, np.array(MODEL.u_max))
        u, again = (np.asarray(spec.excited(command.stamp, command, MODEL).u) for _ in range(2))
        _require(_same([u], [again]), "the same moment gave another input")
        _require(u.shape == (4,) and np.isfinite(u).all(), f"an input is {u.tolist()}")
        _require((u >= MODEL.u_min).all() and (u <= MODEL.u_max).all(), f"an input is {u.tolist()}, beyond its limits")


_START = np.array([0.3, -0.2, 1.0, 0.7, 0.0, 0.0, 0.0, 0.0])
_INPUT = np.array([0.05, -0.03, 0.55, 0.02])


def _flown(spec: Any, stops: Sequence[int]) -> list[Array]:
    plant, step = spec.start(_START), nanoseconds(spec.step)
    for stop in stops:
        plant.advance(stop * step, _INPUT, STILL_AIR)
    truth = plant.truth()
    return [truth.position, truth.quat_wxyz, truth.velocity, truth.angular_velocity, np.array([truth.yaw])]


def starts_where_it_is_put(spec: Any) -> None:
    """It starts at the position, heading and speed that it is given."""
    truth = spec.start(_START).truth()
    _close(truth.position, _START[:3], 1e-9, "position")
    _close(np.array([truth.yaw]), _START[3:4], 1e-9, "yaw")
    _close(truth.velocity, np.zeros(3), 1e-9, "velocity")


def flies_the_same_in_pieces(spec: Any) -> None:
    """A flight in pieces is the flight at once, and both are finite."""
    whole, pieces = _flown(spec, [500]), _flown(spec, [1, 3, 50, 51, 400, 500])
    _require(all(np.isfinite(part).all() for part in whole), "its state is not finite")
    _require(_same(whole, pieces), "a flight in pieces is another flight")


def gives_its_truth_away(spec: Any) -> None:
    """The truth belongs to the caller: it does not change when the flight goes on."""
    plant = spec.start(_START)
    truth = plant.truth()
    before = [np.array(truth.position), np.array(truth.velocity)]
    plant.advance(100 * nanoseconds(spec.step), _INPUT, STILL_AIR)
    _require(_same(before, [truth.position, truth.velocity]), "its arrays are overwritten: return copies")


def _airs(spec: Any, seed: int = 0, count: int = 50) -> list[Array]:
    plant, disturbance = Ideal().start(_START), spec.start(np.random.default_rng(seed))
    rows: list[Array] = []
    for k in range(1, count + 1):
        air = disturbance.air(plant.truth())
        rows.append(np.array([*air.wind, *air.acceleration, air.thrust_factor], float))
        plant.advance(k * PERIOD_NS, _INPUT, air)
    return rows


def blows_finite_air(spec: Any) -> None:
    """Wind and push are three finite numbers each, and thrust is never below zero."""
    for row in _airs(spec):
        _require(row.shape == (7,), f"wind and acceleration have {len(row) - 1} numbers together, not 6")
        _require(np.isfinite(row).all(), f"the air is {row.tolist()}")
        _require(row[6] >= 0.0, f"thrust_factor = {row[6]}")


def blows_the_same_for_the_same_seed(spec: Any) -> None:
    """The same seed gives the same air, and two flights of one value do not share a state."""
    _require(_same(_airs(spec), _airs(spec)), "the same seed gave other air: draw from the generator that start() gets")


Check = Callable[[Any], None]
CHECKS: dict[str, tuple[Check, ...]] = {
    "controllers.trajectories": (
        is_a_frozen_value,
        has_true_derivatives,
        starts_at_rest,
        is_finite_and_above_the_floor,
        is_a_function_of_time,
        can_be_flown_in_the_room,
    ),
    "controllers.laws": (
        is_a_frozen_value,
        says_its_period_and_model,
        sends_finite_inputs,
        is_deterministic,
        leaves_its_inputs_alone,
    ),
    "controllers.estimators": (
        is_a_frozen_value,
        knows_nothing_before_the_first_pose,
        follows_the_poses,
        survives_nonsense,
        estimates_are_repeatable,
    ),
    "controllers.excitations": (is_a_frozen_value, excites_within_the_limits),
    "heli_twin.lab.plant": (
        is_a_frozen_value,
        starts_where_it_is_put,
        flies_the_same_in_pieces,
        gives_its_truth_away,
    ),
    "heli_twin.lab.disturbances": (is_a_frozen_value, blows_finite_air, blows_the_same_for_the_same_seed),
}
"""The checks of each family, by its package."""
