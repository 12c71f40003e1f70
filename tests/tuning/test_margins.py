"""Margins: python-control judges the arithmetic and a whole loop, a flight beyond the margin judges the verdict."""

import json
from dataclasses import dataclass, replace
from typing import Literal

import control
import numpy as np
import pytest

from controllers.detailed_model import DetailedModel
from controllers.laws.pid import Pid
from controllers.model import Model
from controllers.signals import Array, Estimate, Pose
from heli_twin import load
from heli_twin.cli import main
from heli_twin.errors import HeliTwinError
from heli_twin.lab.plant.ideal import Ideal
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.tuning.margins import believed, law_margins


class Difference:
    """Velocities from the last two poses."""

    def __init__(self) -> None:
        self.poses: list[Pose] = []

    def receive(self, now: int, pose: Pose) -> None:
        self.poses = [*self.poses[-1:], pose]

    def command_sent(self, now: int, u: Array) -> None:
        pass

    def estimate(self, now: int) -> Estimate | None:
        if len(self.poses) < 2:
            return None
        before, last = self.poses
        velocity = (last.position - before.position) / (1e-9 * (last.stamp - before.stamp))
        yaw, rate = 2.0 * last.quat_wxyz[3], 2.0 * (last.quat_wxyz[3] - before.quat_wxyz[3]) / 0.02
        x = np.array([*last.position, yaw, *velocity, rate])
        return Estimate(now, x, np.zeros(4), np.zeros((4, 3)), last.stamp, 0)


@dataclass(frozen=True)
class Differences:
    """The estimator's value."""

    kind: Literal["differences"] = "differences"
    lead = 0.0

    def start(self, model: Model) -> Difference:
        return Difference()


def test_the_loop_of_a_pid_in_flight_is_that_of_the_textbook():
    law = Pid(p_x=1.6, i_x=0.4, d_x=1.5)
    flight = replace(load("ideal", ["mocap.rate=50"]), controller=law, estimator=Differences())
    flown = law_margins(flight)["x"]
    T, z = law.period, control.tf("z")
    z.dt = T
    helicopter = control.sample_system(control.tf([2.0], [1.0, 0.5, 0.0]), T, "zoh")
    pid = law.p_x + law.i_x * T / (z - 1) + law.d_x * (z - 1) / (T * z)
    _, phase, stability, _, crossover, _ = control.stability_margins(pid * helicopter)
    assert flown.delay == pytest.approx(np.radians(phase) / crossover, rel=0.03)
    assert flown.crossover == pytest.approx(crossover, rel=0.03)
    assert flown.peak_sensitivity == pytest.approx(1.0 / stability, rel=0.03)


@pytest.mark.long
def test_beyond_its_gain_margin_a_loop_is_unstable():
    law = ["controller.terminal=riccati"]
    margin = law_margins(load("lab_simple", law))["x"].gain
    assert 1.05 < margin < 2.0
    gain = MuJoCo().pitch_gain
    # Close to the margin the probe still shows a stable loop, beyond it a limit cycle at full stick.
    assert law_margins(load("lab_simple", [*law, f"plant.pitch_gain={0.95 * margin * gain}"]))["x"].gain < 1.2
    beyond = law_margins(load("lab_simple", [*law, f"plant.pitch_gain={1.3 * margin * gain}"]))["x"]
    assert beyond.peak_sensitivity > 5.0


def test_the_helicopter_that_a_law_believes_in():
    assert believed(Model(b_x=1.5)) == Ideal(model=Model(b_x=1.5))
    plant = believed(DetailedModel(b_y=1.5, servo_lag=0.05))
    assert isinstance(plant, MuJoCo)
    assert (plant.servo_lag, plant.attitude_frequency, plant.effects) == (0.05, 14.0, ())
    assert plant.roll_gain == pytest.approx(1.5 / 9.81)
    assert plant.inertia_yy / plant.inertia_xx == pytest.approx((16.5 / 14.0) ** 2)


def test_an_unstable_loop_is_said_to_have_no_margins():
    hopeless = load("ideal", ["controller=pid", "controller.p_yaw=50", "controller.p_x=500"])
    with pytest.raises(HeliTwinError, match="no margins"):
        law_margins(replace(hopeless, plant=replace(Ideal(), model=Model(b_x=20.0, b_yaw=900.0))))


def test_the_command_prints_both_helicopters(capsys):
    assert main(["margins", "ideal", "controller=pid", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["twin"]["x"] == printed["believed"]["x"]
    assert printed["twin"]["yaw"]["gain"] > 1.0
