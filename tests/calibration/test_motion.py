"""The fit's own equations are the twin's: they are held against MuJoCo."""

import numpy as np
import pytest

from controllers.excitations.multisine import Multisine
from controllers.model import GRAVITY
from heli_twin.calibration.data import BINS, WINDOW_STEPS
from heli_twin.calibration.drive import _battery
from heli_twin.calibration.motion import Lanes, simulate
from heli_twin.calibration.parameters import NAMES, lab_of, of_experiment, values, vector
from heli_twin.experiment.text import load
from heli_twin.lab.plant import Air

START = np.array([0.2, -0.3, 1.0, 0.4, 0.3, -0.2, 0.1, 0.5])
PUSH = np.array([0.1, 0.05, -0.1])


def flown(*words: str):
    """Two seconds of MuJoCo under a large multisine, and of the copy that is given the same actuators."""
    experiment = load("lab_simple", ["plant.pitch_trim=0.03", "plant.inertia_zz=3.1e-5", "plant.drag_z=0.02", *words])
    plant = experiment.plant
    twin = plant.start(START)
    u = np.array(plant.trim) + Multisine(pitch=0.3, roll=0.3, thrust=0.05, yaw=0.1).inputs(np.arange(2000) * 1e-3)
    poses, acts = [], []
    for k in range(WINDOW_STEPS):
        poses.append(twin._data.qpos[:6].copy())
        twin.advance((k + 1) * 1_000_000, u[k], Air(np.zeros(3), PUSH))
        acts.append(twin._data.act.copy())
    drive = np.array(acts) * [1.0, 1.0, plant.thrust_gain / plant.mass, 1.0]
    theta = vector(np.array([of_experiment(experiment)[name] for name in NAMES]))
    c, s = np.cos(0.4), np.sin(0.4)
    first = np.array([*START[:3], c * 0.3 + s * 0.2, s * 0.3 - c * 0.2, 0.1, 0.4, 0.0, 0.0, 0.5, 0.0, 0.0])
    lanes = Lanes(theta[None], first[None, None], PUSH[None, None], drive[:, None, :, None], np.zeros(1, int))
    # One pose in each bin, at its first step.
    weights = np.zeros((1, WINDOW_STEPS + 1))
    weights[0, :WINDOW_STEPS:20] = 1.0
    out = simulate(lanes, weights, np.zeros((1, BINS)), lab_of(experiment))[0, 0]
    return out, np.array(poses)[::20]


def test_the_copy_flies_like_mujoco():
    out, poses = flown()
    assert np.ptp(poses, axis=0).min() > 0.1
    # The same equations in another order of additions.
    assert np.abs(out - poses).max() < 1e-9


def test_the_copy_has_the_effects_of_the_plant():
    out, poses = flown(*(f"plant.effects.{kind}=on" for kind in ("hub_drag", "thrust_yaw_coupling", "ground_effect")))
    # The ground effect is renewed every 10 ms there; the small net force of the hub's couple is not tilted here.
    assert np.abs(out - poses)[:, :3].max() < 5e-5
    assert np.abs(out - poses)[:, 3:].max() < 5e-6
    assert np.abs(poses - flown()[1]).max() > 0.01


@pytest.mark.parametrize("resistance", [0.28, 0.42])
def test_the_battery_sags_as_the_plants(resistance):
    words = ["plant.effects.ground_effect=off", f"plant.effects.battery.resistance={resistance}"]
    experiment = load("lab", ["supervisor=off", *words])
    plant, believed = experiment.plant, of_experiment(experiment)
    twin = plant.start(START)
    u = np.array(plant.trim) + Multisine(thrust=0.1).inputs(np.arange(2000) * 1e-3)
    acts, factors = [], []
    for k in range(WINDOW_STEPS):
        twin.advance((k + 1) * 1_000_000, u[k], Air(np.zeros(3), np.zeros(3)))
        acts.append(twin._data.act[2])
        factors.append(twin._physics.thrust)
    load_ = believed["thrust_per_mass"] * np.array(acts) / GRAVITY
    factor = _battery(load_, believed["battery_drain"], believed["battery_droop"])
    assert np.ptp(factors) > 0.02
    # It begins with the thrust of the trim; the shares of idle and hover current are those of the default.
    assert np.abs(factor / factors - 1.0)[20:].max() < 1e-3


def test_values_and_vector_are_inverse():
    p = np.array(list(of_experiment(load("lab")).values()))
    assert values(vector(p)) == pytest.approx(p, rel=1e-12)
