"""Conformance: what every member of a family has to keep, ours and a stranger's alike.

A check is a function of a member as a value; it returns nothing, or raises `NotConforming` with one sentence. Use them
in a test suite of your own:

    from heli_twin.conformance import CHECKS
    @pytest.mark.parametrize("check", CHECKS["controllers.laws"], ids=lambda check: check.__name__)
    def test_my_law(check):
        check(MyLaw())
"""

from collections.abc import Callable, Iterator
from dataclasses import FrozenInstanceError, fields, is_dataclass
from typing import Any, NamedTuple

from heli_twin.conformance import (
    coordinations,
    designs,
    estimators,
    faults,
    laws,
    supervisors,
    surroundings,
    trajectories,
)
from heli_twin.conformance.rules import NotConforming, names_its_further_states, require
from heli_twin.experiment.family_needs import needs_of_families

__all__ = ["CHECKS", "Check", "NotConforming", "Verdict", "is_a_frozen_value", "is_frozen", "verdicts"]


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


Check = Callable[[Any], None]
CHECKS: dict[str, tuple[Check, ...]] = {
    "controllers.trajectories": (
        is_a_frozen_value,
        trajectories.has_true_derivatives,
        trajectories.has_true_higher_derivatives,
        trajectories.starts_at_rest,
        trajectories.is_finite_and_above_the_floor,
        trajectories.is_a_function_of_time,
        trajectories.can_be_flown_in_the_room,
    ),
    "controllers.laws": (
        is_a_frozen_value,
        laws.says_its_period_and_model,
        laws.sends_finite_inputs,
        laws.is_deterministic,
        laws.leaves_its_inputs_alone,
        names_its_further_states,
    ),
    "controllers.estimators": (
        is_a_frozen_value,
        estimators.knows_nothing_before_the_first_pose,
        estimators.follows_the_poses,
        estimators.survives_nonsense,
        estimators.estimates_are_repeatable,
        names_its_further_states,
        estimators.estimates_its_further_states,
    ),
    "controllers.excitations": (is_a_frozen_value, laws.excites_within_the_limits),
    "heli_twin.lab.plant": (
        is_a_frozen_value,
        surroundings.starts_where_it_is_put,
        surroundings.flies_the_same_in_pieces,
        surroundings.gives_its_truth_away,
    ),
    "controllers.supervisors": (
        is_a_frozen_value,
        supervisors.orders_what_can_be_flown,
        supervisors.orders_the_same_again,
        supervisors.leaves_the_plan_alone,
        supervisors.lets_a_good_flight_fly,
    ),
    "controllers.coordinations": (
        is_a_frozen_value,
        coordinations.begins_with_the_wish,
        coordinations.plans_join,
        coordinations.plans_the_same_again,
    ),
    "heli_twin.lab.disturbances": (
        is_a_frozen_value,
        surroundings.blows_finite_air,
        surroundings.blows_the_same_for_the_same_seed,
    ),
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
