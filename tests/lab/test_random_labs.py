"""Any combination of effects and faults inside their bounds gives an outcome and finite numbers, never an exception."""

from typing import get_args

import numpy as np
import pytest
from annotated_types import Ge, Gt, Le, Lt

from heli_twin import Experiment, fly, load
from heli_twin.experiment.families import members
from heli_twin.experiment.fields import fields_of
from heli_twin.flight import OutcomeKind

EFFECTS = members("heli_twin.lab.plant.effects")
FAULTS = members("heli_twin.lab.faults")
DISTURBANCES = members("heli_twin.lab.disturbances")
MARGIN = 1e-3
"""Share of the way to an open or absent bound that a drawn value keeps away from it."""


def drawn(rng: np.random.Generator, spec: type, path: str) -> list[str]:
    """Overrides that give each field of a member a value inside its bounds; half of them keep their default."""
    changes = [f"{path}=on"]
    for name, info in fields_of(spec).items():
        default = getattr(spec(), name)
        if name == "kind" or not info.is_plain or rng.random() < 0.5:
            continue
        if isinstance(default, str):
            value = rng.choice(get_args(info.type))
        else:
            low, high = bounds(spec, name, default)
            value = type(default)(rng.uniform(low, high))
        changes.append(f"{path}.{name}={value}")
    return changes


def bounds(spec: type, name: str, default: float) -> tuple[float, float]:
    """Least and greatest value of a field; where there is no bound, ten times the default."""
    limits = spec.__annotations__[name].__metadata__
    low = next((m.ge if isinstance(m, Ge) else m.gt for m in limits if isinstance(m, Ge | Gt)), -10 * abs(default) - 1)
    high = next((m.le if isinstance(m, Le) else m.lt for m in limits if isinstance(m, Le | Lt)), 10 * abs(default) + 1)
    # Times of hours would never begin.
    high = min(high, 3.0) if name in ("start", "duration") else high
    return low + MARGIN * (high - low), high - MARGIN * (high - low)


def random_lab(seed: int) -> Experiment:
    """A lab with random effects, faults, disturbances, trajectory, controller and plant."""
    rng = np.random.default_rng(seed)
    changes = ["duration=3", f"seed={seed}"]
    changes += [f"trajectory={rng.choice(['hover', 'circle', 'takeoff_and_landing'])}"]
    changes += [f"controller={rng.choice(['ltv_mpc', 'pid'])}", f"plant={rng.choice(['mujoco', 'mujoco', 'ideal'])}"]
    effects = EFFECTS if "plant=mujoco" in changes else {}
    # Those of the lab are off unless they are drawn.
    changes += [f"plant.effects.{kind}=off" for kind in effects]
    for family, share, path in (
        (effects, 0.4, "plant.effects"),
        (FAULTS, 0.15, "faults"),
        (DISTURBANCES, 0.3, "disturbances"),
    ):
        for kind, spec in family.items():
            if rng.random() < share:
                changes += drawn(rng, spec, f"{path}.{kind}")
    return load("lab", changes)


def check(seed: int) -> None:
    experiment = random_lab(seed)
    result = fly(experiment, log_dir=None)
    assert result.outcome.kind in get_args(OutcomeKind), experiment
    log = result.log
    # A flight that diverges ends with the first state that is not finite; nothing before it is.
    ended = result.outcome.kind == "diverged"
    for values in (log.truth.position, log.truth.quat_wxyz, log.truth.velocity, log.truth.actuators):
        assert np.isfinite(values[: len(values) - ended]).all(), experiment
    for values in (log.estimate.x, log.estimate.variance, log.sent.u, log.acting.u, log.battery.voltage):
        assert np.isfinite(values).all(), experiment
    assert np.isfinite([*log.disturbance.wind.ravel(), *log.disturbance.acceleration.ravel()]).all()


@pytest.mark.parametrize("seed", range(50))
def test_any_lab_has_an_outcome_and_finite_numbers(seed: int) -> None:
    check(seed)


@pytest.mark.long
@pytest.mark.parametrize("tens", range(50, 500, 10))
def test_any_of_500_labs_has_an_outcome_and_finite_numbers(tens: int) -> None:
    for seed in range(tens, tens + 10):
        check(seed)
