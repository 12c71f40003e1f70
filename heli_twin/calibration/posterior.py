"""What the flights leave open: the posterior, helicopters drawn from it, and a study that flies them."""

import json
from typing import Any

import numpy as np

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.calibrate import Calibrated
from heli_twin.calibration.coverage import covered
from heli_twin.calibration.output import believed_model, point, twin_of
from heli_twin.calibration.parameters import NAMES, POSITIVE, SPREAD, values
from heli_twin.calibration.unknowns import FIXED
from heli_twin.experiment.tree import table_of

JOINT_FACTOR = 1.5
"""The joint 95 % region is that of the model's covariance times this. Chosen on pilot twins that no test judges."""
DRAWS = 20
"""Helicopters of an ensemble."""


def posterior(calibrated: Calibrated) -> dict[str, Any]:
    """Return the posterior: mean and covariance of the fit's vector, the noise, and how much of it is the prior's."""
    fit = calibrated.fit
    free = fit.problem.spread > FIXED
    share = np.where(free, np.diag(fit.covariance) / fit.problem.spread**2, 1.0)
    return {
        "names": list(NAMES),
        "is_logarithm": POSITIVE.tolist(),
        "mean": fit.state.theta.tolist(),
        "covariance": (JOINT_FACTOR * fit.covariance).tolist(),
        "standard_deviation": fit.deviation.tolist(),
        "prior_mean": fit.problem.prior.tolist(),
        "prior_standard_deviation": SPREAD.tolist(),
        "prior_share": share.tolist(),
        "noise": dict(zip(noise.COMPONENTS, np.exp(fit.state.eta).tolist(), strict=True)),
        "joint_factor": JOINT_FACTOR,
    }


def draws(calibrated: Calibrated, count: int = DRAWS, seed: int = 0) -> list[dict[str, float]]:
    """Return parameters by name of helicopters that the flights do not tell apart, drawn from the posterior."""
    fit = calibrated.fit
    root = np.linalg.cholesky(JOINT_FACTOR * fit.covariance + 1e-18 * np.eye(len(NAMES)))
    normal: Array = np.random.default_rng(seed).standard_normal((count, len(NAMES)))
    return [dict(zip(NAMES, values(theta).tolist(), strict=True)) for theta in fit.state.theta + normal @ root.T]


def ensemble(calibrated: Calibrated, count: int = DRAWS) -> str:
    """Return a study that flies helicopters drawn from the posterior, embedded by value, with one controller."""
    lines = [
        'name = "ensemble"',
        'question = "How differently do helicopters fly that the calibration flights cannot tell apart?"',
        "replicates = 3",
        "",
        "[base]",
        'preset = "lab"',
        "",
        "[base.controller.model]",
        *(f"{name} = {value:.6g}" for name, (value, _) in believed_model(point(calibrated)).items()),
        "",
        "[base.envelope]",
        *(f"{name} = {json.dumps(v)}" for name, v in covered(calibrated.fit.problem.flights).plain().items()),
    ]
    for i, p in enumerate(draws(calibrated, count), 1):
        twin = twin_of(calibrated.base, p, calibrated.mass, calibrated.kept)
        table = table_of(twin.plant)
        effects = table.pop("effects")
        lines += ["", f"[alternatives.draw_{i:02d}.plant]"]
        lines += [f"{name} = {json.dumps(value)}" for name, value in table.items()]
        for name, effect in effects.items():
            lines += [f"[alternatives.draw_{i:02d}.plant.effects.{name}]"]
            lines += [f"{key} = {json.dumps(value)}" for key, value in effect.items()]
    return "\n".join(lines) + "\n"
