"""Hidden twins: helicopters and labs that differ from the believed one in everything, and what is found of them."""

from dataclasses import replace

import numpy as np

from controllers.markers import by_name
from heli_twin.calibration.calibrate import Calibrated, calibrate, flights_of
from heli_twin.calibration.flights import planned
from heli_twin.calibration.parameters import NAMES, of_experiment, vector
from heli_twin.calibration.posterior import JOINT_FACTOR
from heli_twin.calibration.unknowns import FIXED
from heli_twin.experiment import Experiment
from heli_twin.experiment.text import load
from heli_twin.lab.disturbances.bias import Bias
from heli_twin.mission import fly

SCALED = (
    *("mass", "inertia_xx", "inertia_yy", "inertia_zz", "thrust_gain", "pitch_gain", "roll_gain", "yaw_gain"),
    *("yaw_damping", "drag_x", "drag_y", "drag_z", "attitude_frequency", "attitude_damping"),
    *("servo_lag", "thrust_lag", "yaw_lag"),
)
OF_EFFECTS = {
    "hub_drag": ("height",),
    "battery": ("capacity", "resistance", "idle_current", "hover_current"),
    "servo": ("slew", "backlash", "deadband"),
    "thrust_yaw_coupling": ("lever",),
}


def hidden(lab: str, seed: int) -> Experiment:
    """A lab whose helicopter has every positive parameter within 25 % of the believed one, other trims and delays."""
    rng = np.random.default_rng(seed)
    believed = load(lab, ["supervisor=off"])

    def scaled(spec, names):
        return replace(spec, **{name: getattr(spec, name) * rng.uniform(0.75, 1.25) for name in names})

    while True:
        try:
            plant = scaled(believed.plant, SCALED)
        except ValueError:
            # No rigid body's inertias.
            continue
        # One that the believed model can fly: up to a quarter more or less thrust for its weight.
        if 0.75 < plant.thrust_gain / plant.mass / 18.0 < 1.25:
            break
    trims = rng.uniform(-0.05, 0.05, 3).tolist()
    effects = tuple(scaled(effect, OF_EFFECTS.get(name, ())) for name, effect in by_name(plant.effects).items())
    plant = replace(
        plant,
        **dict(zip(("pitch_trim", "roll_trim", "yaw_trim"), trims, strict=True)),
        drag_z=plant.drag_z or float(rng.uniform(0.0, 0.03)),
        input_delay=float(rng.integers(0, 11)) * 1e-3,
        effects=effects,
    )
    gust = scaled(next(d for d in believed.disturbances if d.kind == "gust"), ("strength", "time"))
    push = Bias("bias", *rng.uniform(-0.15, 0.15, 3).tolist())
    mocap = scaled(believed.mocap, ("position_noise", "bias", "orientation_noise"))
    return replace(
        believed,
        plant=plant,
        disturbances=(push, gust),
        mocap=replace(mocap, latency=float(rng.uniform(0.005, 0.015))),
        compute=replace(believed.compute, latency=float(rng.uniform(0.004, 0.008))),
        radio=replace(believed.radio, latency=float(rng.uniform(0.003, 0.008))),
        seed=10 * seed,
    )


def calibrated(experiment: Experiment, *, believed: str = "lab", anyway: bool = False) -> Calibrated:
    """What the two calibration flights of a lab tell of its helicopter."""
    logs = []
    for flight in planned(experiment)[:2]:
        result = fly(flight.experiment, log_dir=None)
        assert result.outcome.kind == "completed", f"{flight.name}: {result.outcome.text}"
        logs.append((flight.name, result.log, flight.experiment.seed))
    base = load(believed)
    return calibrate(flights_of(logs, base), base, anyway=anyway)


def truth(experiment: Experiment) -> dict[str, float]:
    gust = next(d for d in experiment.disturbances if d.kind == "gust")
    return of_experiment(experiment) | {"gust_strength": gust.strength, "gust_time": gust.time}


def joint(found: Calibrated, experiment: Experiment) -> tuple[float, int]:
    """Squared distance of the told parameters from the truth, in the covariance of the joint region."""
    known, true = found.parameters, truth(experiment)
    at = [i for i, name in enumerate(NAMES) if found.fit.problem.spread[i] > FIXED and known[name].told]
    miss = (found.fit.state.theta - vector(np.array([true[name] for name in NAMES])))[at]
    return float(miss @ np.linalg.solve(JOINT_FACTOR * found.fit.covariance[np.ix_(at, at)], miss)), len(at)
