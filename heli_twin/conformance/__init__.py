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
from controllers.laws import StateReader, closed_after, extra_states, flat_derivatives
from controllers.model import Model
from controllers.reference import ReferencePreview, check_feasible
from controllers.signals import NO_STATES, Array, Command, Estimate, Plan, Pose, Reference, nanoseconds
from controllers.trajectories import SmoothTrajectory, fitted
from controllers.trajectories.hover import Hover
from heli_twin.conformance import designs, faults, supervisors
from heli_twin.conformance.rules import NotConforming, close, names_its_further_states, require, same
from heli_twin.experiment.families import needs_of_families
from heli_twin.lab.disturbances import ALONE, PERIOD_NS, air_of
from heli_twin.lab.plant import STILL_AIR, Air
from heli_twin.lab.plant.ideal import Ideal

MODEL = Model()


class Verdict(NamedTuple):
    """The outcome of one check."""

    rule: str
    trouble: str
    """The reason why it does not hold, one sentence; empty where it holds."""


def verdicts(family: str, spec: Callable[[], Any]) -> Iterator[Verdict]:
    """Run every check of a family on a member with its defaults; what a member raises is a verdict too.

    Args:
        family: Package of the family; one without checks of its own gets those of every value.
        spec: Class of the member, or another function that makes it.
    """
    if not family:
        yield Verdict(
            "It is a member of a family.", f"{spec.__name__} has the attributes of none: {needs_of_families()}"
        )
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


def is_a_frozen_value(member: Any) -> None:
    """It is a frozen dataclass whose first field is its kind, equal to another of the same fields, and hashable."""
    is_frozen(member)
    require(hash(type(member)()) == hash(type(member)()), f"two {type(member).__name__}() have other hashes")


def is_frozen(member: Any) -> None:
    """It is a frozen dataclass whose first field is its kind, equal to another of the same fields."""
    spec = type(member)
    require(is_dataclass(member), f"{spec.__name__} is no dataclass: write @dataclass(frozen=True)")
    require(fields(member)[0].name == "kind", f"the first field of {spec.__name__} has to be kind")
    try:
        member.kind = member.kind
    except FrozenInstanceError:
        pass
    else:
        raise NotConforming(f"{spec.__name__} can be changed: write @dataclass(frozen=True)")
    require(spec() == spec(), f"two {spec.__name__}() are not equal")
    require(spec.__doc__, f"{spec.__name__} has no docstring: say in a sentence what it is")


_STEP_S = 1e-4
_TIMES_S = np.arange(_STEP_S, 40.0, 0.0137)


def _slope(values: Callable[[Array], Array]) -> Array:
    """Central difference of a function of time."""
    return (values(_TIMES_S + _STEP_S) - values(_TIMES_S - _STEP_S)) / (2.0 * _STEP_S)


def has_true_derivatives(trajectory: Any) -> None:
    """The derivatives of its flat outputs are those of its path."""
    flat = fitted(trajectory, MODEL).flat
    # Half the step squared times the third derivative (below 50 in a room) is 3e-7; where that one jumps, at the end
    # of a ramp, the step times the jump: 1e-3 at most.
    close(_slope(lambda t: flat(t).z), flat(_TIMES_S).dz, 1e-6, "dz is not the derivative of z")
    close(_slope(lambda t: flat(t).dz), flat(_TIMES_S).ddz, 1e-3, "ddz is not the derivative of dz")


def can_be_flown_in_the_room(trajectory: Any) -> None:
    """The believed helicopter can fly it for a minute."""
    check_feasible(trajectory, MODEL, 60.0, 0.02)


def starts_at_rest(trajectory: Any) -> None:
    """It starts at rest, so that nothing jumps at the first command."""
    flat = fitted(trajectory, MODEL).flat(np.zeros(1))
    close(flat.dz, np.zeros((1, 4)), 0.0, "it moves at time 0")
    close(feed_forward(MODEL, flat)[0], np.array(MODEL.u_hover), 1e-12, "its first input is no hover")


def is_finite_and_above_the_floor(trajectory: Any) -> None:
    """At every time from 0 to 10 hours it has a finite point above the floor."""
    t = np.concatenate([[0.0], np.geomspace(1e-9, 36_000.0, 2000)])
    flat = fitted(trajectory, MODEL).flat(t)
    for name, values in zip(("z", "dz", "ddz"), flat, strict=False):
        require(values.shape == (len(t), 4), f"{name} has shape {values.shape}, not ({len(t)}, 4)")
        require(np.isfinite(values).all(), f"{name} is not finite at some time")
    require((flat.z[:, 2] > 0.0).all(), f"it goes down to {flat.z[:, 2].min():.3g} m")


def is_a_function_of_time(trajectory: Any) -> None:
    """A point does not depend on which others are asked for."""
    flat, t = fitted(trajectory, MODEL).flat, np.linspace(0.0, 40.0, 101)
    together = flat(t)
    for i in (0, 37, 100):
        # Vectorised sines may differ in their last digit.
        close(flat(t[i : i + 1]).z[0], together.z[i], 1e-12, "z depends on the other times")
        close(flat(t[i : i + 1]).ddz[0], together.ddz[i], 1e-9, "ddz depends on the other times")


_HIGHEST = 6
"""Highest derivative that is checked."""


def has_true_higher_derivatives(trajectory: Any) -> None:
    """If it gives higher derivatives, they belong to its path, and those it calls continuous do not jump."""
    trajectory = fitted(trajectory, MODEL)
    if not isinstance(trajectory, SmoothTrajectory):
        return
    of = trajectory.derivatives
    found = of(_TIMES_S, _HIGHEST)
    require(found.shape == (_HIGHEST + 1, len(_TIMES_S), 4), f"derivatives(t, {_HIGHEST}) has shape {found.shape}")
    close(found[:3], np.stack(trajectory.flat(_TIMES_S)), 1e-9, "derivatives are not those of flat()")
    largest = np.abs(found).max(axis=(1, 2))
    for k in range(2, _HIGHEST):
        slope = _slope(lambda t, k=k: of(t, k)[k])
        off = np.abs(slope - found[k + 1]).max(axis=1) > 1e-3 * max(largest[k + 1], largest[k], 1e-9)
        # Within 0.1 ms of a jump the central difference means nothing: allowed at 2 % of the times.
        require(off.mean() <= 0.02, f"derivative {k + 1} is not the slope of derivative {k}")
    for k in range(min(trajectory.smoothness, _HIGHEST - 1) + 1):
        step = float(np.abs(np.diff(found[k], axis=0)).max())
        most = 1.01 * largest[k + 1] * float(_TIMES_S[1] - _TIMES_S[0]) + 1e-9
        require(step <= most, f"derivative {k} jumps by {step:.3g}, and smoothness is {trajectory.smoothness}")


def _hover_steps(law: Any, count: int = 40) -> tuple[list[Array], list[tuple[Estimate, Reference]]]:
    """The commands of a law in a hover that it is pushed out of, and what it was given."""
    with closed_after(law.start()) as controller:
        return _steps_of(controller, law, count)


def _steps_of(controller: Any, law: Any, count: int) -> tuple[list[Array], list[tuple[Estimate, Reference]]]:
    period = nanoseconds(law.period)
    preview = ReferencePreview(Hover(), law.model, period, 0, flat_derivatives(law))
    plant = Ideal(step=law.period).start(state(Hover().flat(np.zeros(1)))[0])
    # What the law reads beyond the physical states is at rest.
    further = np.zeros(len(law.estimated_states)) if isinstance(law, StateReader) else NO_STATES
    sent, given = [], []
    for k in range(count):
        now = k * period
        truth = plant.truth()
        c, s = np.cos(truth.yaw), np.sin(truth.yaw)
        vx, vy, vz = truth.velocity
        x = np.array([*truth.position, truth.yaw, c * vx + s * vy, c * vy - s * vx, vz, truth.yaw_rate])
        estimate = Estimate(now, x, np.zeros(4), np.full((4, 3), 1e-4), now, 0, further, 0.0 * further)
        reference = preview(now, law.steps)
        command = controller.explain(controller.step(now, estimate, reference))
        _is_a_plan_of(law, command.plan)
        sent.append(np.array(command.u))
        given.append((estimate, reference))
        plant.advance(now + period, np.clip(command.u, -1, 1), Air(np.zeros(3), np.array([0.3, -0.2, 0.1])))
    return sent, given


def _is_a_plan_of(law: Any, plan: Plan | None) -> None:
    """Refuse a plan that no log can hold."""
    if plan is None:
        return
    rows, width = plan.x.shape
    right = width in (8, 10) and plan.u.shape == plan.u_nominal.shape == (rows - 1, 4)
    require(right, f"a plan has states {plan.x.shape} and inputs {plan.u.shape}, not (N + 1, 8 or 10) and (N, 4)")
    found = 0 if plan.extra is None else plan.extra.shape[1]
    require(
        found == len(extra_states(law)), f"a plan has {found} further states, extra_states {len(extra_states(law))}"
    )


def says_its_period_and_model(law: Any) -> None:
    """It has a positive period, a whole number of steps, and a believed model."""
    require(0.0 < law.period <= 1.0, f"period = {law.period} s: it has to be above 0 and at most 1 s")
    require(
        isinstance(law.steps, int) and law.steps >= 1, f"steps = {law.steps}: it has to be a whole number from 1 on"
    )
    require(isinstance(law.model, Model), "model has to be a controllers.model.Model")


def sends_finite_inputs(law: Any) -> None:
    """Every command is four finite inputs within full stick, decided at the control time."""
    for u in _hover_steps(law)[0]:
        require(u.shape == (4,), f"a command has shape {u.shape}, not (4,)")
        require(np.isfinite(u).all(), f"a command is {u.tolist()}")
        require((np.abs(u) <= 1.0).all(), f"a command is {u.tolist()}: full stick is 1")


def is_deterministic(law: Any) -> None:
    """Two flights of one value are equal, and do not share a state."""
    first, second = _hover_steps(law)[0], _hover_steps(law)[0]
    require(same(first, second), "the same flight gave other commands: start() has to make a new controller")


def leaves_its_inputs_alone(law: Any) -> None:
    """It does not change the estimate and the reference that it is given."""
    period = nanoseconds(law.period)
    preview = ReferencePreview(Hover(), law.model, period, 0)
    for estimate, reference in _hover_steps(law, 3)[1]:
        fresh = preview(estimate.stamp, law.steps)
        require(
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
    require(spec.start(MODEL).estimate(0) is None, "it has an estimate without a pose")


def follows_the_poses(spec: Any) -> None:
    """Without noise it follows a slow circle within 5 cm and 10 cm/s, with finite numbers."""
    poses = list(_poses(800))
    last = _estimates(spec, poses)[-1]
    require(last is not None, "it has no estimate after 4 s of poses")
    assert last is not None
    t = 1e-9 * last.stamp
    wanted = np.array([0.1 * np.sin(t), 0.1 - 0.1 * np.cos(t), 1.0, 0.0, 0.1 * np.cos(t), 0.1 * np.sin(t), 0.0, 0.0])
    require(last.x.shape == (8,) and np.isfinite(last.x).all(), f"its state is {last.x.tolist()}")
    close(last.x[:4], wanted[:4], 0.05, "position and yaw")
    close(last.x[4:], wanted[4:], 0.1, "velocity")


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
    require(last is not None and np.isfinite(last.x).all(), "its estimate is not finite any more")


def estimates_its_further_states(spec: Any) -> None:
    """Every estimate has as many further states as it names, finite, and a variance of each or none."""
    count = len(extra_states(spec))
    for estimate in _estimates(spec, list(_poses(200))):
        if estimate is not None:
            extra, variance = estimate.extra, estimate.extra_variance
            right = extra.shape == (count,) and variance.shape in ((count,), (0,))
            require(right, f"it has {extra.shape} further states and {variance.shape} variances, and names {count}")
            require(np.isfinite(extra).all(), f"its further states are {extra.tolist()}")


def estimates_are_repeatable(spec: Any) -> None:
    """Two flights of one value are equal."""
    poses = list(_poses(200))
    first, second = _estimates(spec, poses), _estimates(spec, poses)
    require(same([e.x for e in first if e], [e.x for e in second if e]), "the same poses gave another estimate")


def excites_within_the_limits(spec: Any) -> None:
    """It adds the same finite inputs every time it is asked, and the sum keeps the limits of the inputs."""
    for k in range(200):
        command = Command(k * 20_000_000, np.array(MODEL.u_max))
        u, again = (np.asarray(spec.excited(command.stamp, command, MODEL).u) for _ in range(2))
        require(same([u], [again]), "the same moment gave another input")
        require(u.shape == (4,) and np.isfinite(u).all(), f"an input is {u.tolist()}")
        require((u >= MODEL.u_min).all() and (u <= MODEL.u_max).all(), f"an input is {u.tolist()}, beyond its limits")


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
    close(truth.position, _START[:3], 1e-9, "position")
    close(np.array([truth.yaw]), _START[3:4], 1e-9, "yaw")
    close(truth.velocity, np.zeros(3), 1e-9, "velocity")


def flies_the_same_in_pieces(spec: Any) -> None:
    """A flight in pieces is the flight at once, and both are finite."""
    whole, pieces = _flown(spec, [500]), _flown(spec, [1, 3, 50, 51, 400, 500])
    require(all(np.isfinite(part).all() for part in whole), "its state is not finite")
    require(same(whole, pieces), "a flight in pieces is another flight")


def gives_its_truth_away(spec: Any) -> None:
    """The truth belongs to the caller: it does not change when the flight goes on."""
    plant = spec.start(_START)
    truth = plant.truth()
    before = [np.array(truth.position), np.array(truth.velocity)]
    plant.advance(100 * nanoseconds(spec.step), _INPUT, STILL_AIR)
    require(same(before, [truth.position, truth.velocity]), "its arrays are overwritten: return copies")


def _airs(spec: Any, seed: int = 0, count: int = 50, others: Array = ALONE) -> list[Array]:
    plant, disturbance = Ideal().start(_START), air_of(spec.start(np.random.default_rng(seed)))
    rows: list[Array] = []
    for k in range(1, count + 1):
        air = disturbance(plant.truth(), others)
        moment = np.zeros(3) if air.moment is None else air.moment
        rows.append(np.array([*air.wind, *air.acceleration, air.thrust_factor, *moment], float))
        plant.advance(k * PERIOD_NS, _INPUT, air)
    return rows


def blows_finite_air(spec: Any) -> None:
    """Wind, push and moment are three finite numbers each, and thrust is never below zero, alone or with others."""
    others = _START[:3] + np.array([[0.1, 0.0, 0.5], [1.0, 0.0, 0.0]])
    for row in _airs(spec) + _airs(spec, others=others):
        require(row.shape == (10,), f"wind, acceleration and moment have {len(row) - 1} numbers together, not 9")
        require(np.isfinite(row).all(), f"the air is {row.tolist()}")
        require(row[6] >= 0.0, f"thrust_factor = {row[6]}")


def blows_the_same_for_the_same_seed(spec: Any) -> None:
    """The same seed gives the same air, and two flights of one value do not share a state."""
    require(same(_airs(spec), _airs(spec)), "the same seed gave other air: draw from the generator that start() gets")


Check = Callable[[Any], None]
CHECKS: dict[str, tuple[Check, ...]] = {
    "controllers.trajectories": (
        is_a_frozen_value,
        has_true_derivatives,
        has_true_higher_derivatives,
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
        names_its_further_states,
    ),
    "controllers.estimators": (
        is_a_frozen_value,
        knows_nothing_before_the_first_pose,
        follows_the_poses,
        survives_nonsense,
        estimates_are_repeatable,
        names_its_further_states,
        estimates_its_further_states,
    ),
    "controllers.excitations": (is_a_frozen_value, excites_within_the_limits),
    "heli_twin.lab.plant": (
        is_a_frozen_value,
        starts_where_it_is_put,
        flies_the_same_in_pieces,
        gives_its_truth_away,
    ),
    "controllers.supervisors": (
        is_a_frozen_value,
        supervisors.orders_what_can_be_flown,
        supervisors.orders_the_same_again,
        supervisors.leaves_the_plan_alone,
        supervisors.lets_a_good_flight_fly,
    ),
    "heli_twin.lab.disturbances": (is_a_frozen_value, blows_finite_air, blows_the_same_for_the_same_seed),
    "heli_twin.lab.faults": (
        is_a_frozen_value,
        faults.hooks_a_wire,
        faults.passes_on_what_the_wire_carries,
        faults.breaks_the_same_for_the_same_seed,
        faults.leaves_what_it_is_given_alone,
    ),
    "heli_twin.studies.designs": (
        is_frozen,
        designs.says_which_axes_it_can_use,
        designs.flies_no_more_than_it_counts,
        designs.asks_for_what_can_be_flown,
        designs.asks_for_the_same_points_again,
    ),
}
"""The checks of each family, by its package."""
