"""The detailed law and its estimator, in flight and alone."""

from dataclasses import dataclass, replace
from typing import Literal

import daqp
import numpy as np
import pytest

from controllers.detailed_model import DetailedModel
from controllers.estimators.detailed_kalman import DetailedKalman
from controllers.flatness import FlatOutput
from controllers.laws.detailed_mpc import DetailedMpc
from controllers.laws.ltv_mpc import LtvMpc
from controllers.laws.pid import Pid
from controllers.signals import Array, Estimate, Reference
from heli_twin import Experiment, ExperimentError, fly, load, read_log
from heli_twin.reanalysis.reestimate import reestimate


def flown(tmp_path, experiment: Experiment):
    result = fly(experiment, log_dir=tmp_path)
    assert result.outcome.kind == "completed"
    assert result.path
    return result.summary(), read_log(result.path)


def detailed(*overrides: str, preset: str = "lab_simple") -> Experiment:
    return load(preset, ["controller=detailed_mpc", "estimator=detailed_kalman", *overrides])


@pytest.mark.parametrize("trajectory", ["hover", "circle", "lemniscate"])
def test_it_errs_by_less_than_half_of_the_papers_model_and_its_filter_is_consistent(tmp_path, trajectory):
    flight = (f"trajectory={trajectory}", "duration=10", "seed=3")
    plain, _ = flown(tmp_path, load("lab_simple", flight))
    summary, log = flown(tmp_path, detailed(*flight))
    for axis in "xy":
        assert summary["rmse"][axis] < 0.5 * plain["rmse"][axis]
    assert summary["max_abs_error"]["z"] < 0.004
    again = reestimate(log)
    assert 4.0 < again.nees(log.truth).values.mean() < 16.0
    assert 3.0 < again.nis().values.mean() < 5.0


def test_its_preset_is_the_lab():
    lab, preset = load("lab"), load("detailed")
    assert replace(preset, controller=lab.controller, estimator=lab.estimator) == lab


def test_the_law_asks_for_its_estimator():
    with pytest.raises(ExperimentError, match="take estimator=detailed_kalman"):
        fly(load("lab", ["controller=detailed_mpc"]), log_dir=None)


@pytest.mark.parametrize("law", [LtvMpc(), Pid()])
def test_the_estimator_serves_laws_with_the_papers_model(law):
    flight = replace(load("lab_simple", ["duration=3"]), controller=law, estimator=DetailedKalman())
    assert fly(flight, log_dir=None).outcome.kind == "completed"


def test_without_disturbances_the_reference_is_flown_with_its_own_inputs():
    law = DetailedMpc()
    estimate = Estimate(0, np.zeros(8), np.zeros(4), np.zeros((4, 3)), 0, 0, np.zeros(12), np.zeros(12))
    estimate.extra[6] = 9.81
    flat = np.zeros((6, law.steps + 1, 4))

    reference = Reference(0, flat[0][:, [0] * 8], np.zeros((law.steps, 4)), flat)
    u = law.start().step(0, estimate, reference).u
    np.testing.assert_allclose(u, law.model.u_hover, atol=1e-9)


def test_a_push_is_countered_and_a_gust_the_less_the_sooner_it_is_over():
    def pitch(push: float, gust: float, gust_time: float = 0.7) -> float:
        law = DetailedMpc(model=DetailedModel(gust_time=gust_time))
        estimate = Estimate(0, np.zeros(8), np.zeros(4), np.zeros((4, 3)), 0, 0, np.zeros(12), np.zeros(12))
        estimate.disturbance[0] = push + gust
        estimate.extra[[0, 2, 6, 8]] = -push, -push / law.model.b_x, 9.81, gust
        flat = np.zeros((6, law.steps + 1, 4))

        reference = Reference(0, flat[0][:, [0] * 8], np.zeros((law.steps, 4)), flat)
        return float(law.start().step(0, estimate, reference).u[0])

    assert pitch(0.2, 0.0) == pytest.approx(-0.1, abs=1e-6)
    assert pitch(0.0, 0.2) < 2.0 * pitch(0.0, 0.2, gust_time=0.1) < 0.0


@pytest.mark.parametrize("yaw", [-2.0, 0.7])
def test_the_whole_situation_turned_needs_the_same_sticks(yaw):
    def sticks(heading: float) -> Array:
        turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        x = np.zeros(8)
        x[:2], x[3], x[4:6] = turn @ (0.03, -0.02), heading, (0.05, 0.1)
        estimate = Estimate(0, x, np.zeros(4), np.zeros((4, 3)), 0, 0, np.zeros(12), np.zeros(12))
        estimate.extra[6], estimate.extra[8:10] = 9.81, turn @ (0.1, -0.05)
        estimate.disturbance[:2] = turn @ (0.15, 0.02)
        law = DetailedMpc()
        flat = np.zeros((6, law.steps + 1, 4))
        flat[0, :, 3] = heading
        planned = np.zeros((law.steps + 1, 8))
        planned[:, 3] = heading
        return law.start().step(0, estimate, Reference(0, planned, np.zeros((law.steps, 4)), flat)).u

    np.testing.assert_allclose(sticks(yaw), sticks(0.0), atol=1e-6)


def kept(x, before: Array, law: DetailedMpc) -> Array:
    """The inputs that a law in hover plans from a state x (8,) after it has sent `before`, and DAQP's."""
    estimate = Estimate(0, np.asarray(x, float), np.zeros(4), np.zeros((4, 3)), 0, 0, np.zeros(12))
    flat = np.zeros((6, law.steps + 1, 4))
    flat[0, :, 2] = 1.0
    reference = Reference(0, np.tile([0, 0, 1.0, 0, 0, 0, 0, 0], (law.steps + 1, 1)), np.zeros((law.steps, 4)), flat)
    controller = law.start()
    controller.linearise_along(np.tile(before, (law.steps, 1)))
    controller.before = before
    ltv, qps = controller.problem(estimate, reference)
    plan = controller.explain(controller.step(0, estimate, reference)).plan
    assert plan is not None
    found = ltv.u_nominal.copy()
    for part, qp in zip((slice(0, 2), slice(2, 4)), qps, strict=True):
        upper, lower = np.append(qp.u_high, qp.v_high), np.append(qp.u_low, qp.v_low)
        du, _, flag, _ = daqp.solve(qp.H, qp.g, qp.C, upper, lower, np.zeros(len(upper), np.int32))
        assert flag == 1
        found[:, part] += du.reshape(law.steps, 2)
    return np.array([plan.u, found])


@pytest.mark.parametrize("size", [0.05, 0.2, 0.4])
def test_no_servo_is_asked_to_move_faster_than_it_can(size):
    slow, rng = DetailedMpc(model=DetailedModel(servo_slew=2.5)), np.random.default_rng(1)
    for _ in range(8):
        x = np.array([0, 0, 1.0, 0, 0, 0, 0, 0]) + size * rng.uniform(-1, 1, 8) * [1, 1, 0.5, 1, 3, 3, 2, 10]
        before = np.array([*rng.uniform(-1, 1, 2), 0.55, 0.0])
        plan, judged = kept(x, before, slow)
        # To the solver's tolerance. 2.5 full sticks a second are 0.05 in a period.
        assert 0.05 - 1e-4 < np.abs(np.diff(plan, axis=0, prepend=before[None]))[:, :2].max() < 0.05 + 1e-4
        np.testing.assert_allclose(plan, judged, rtol=0, atol=1e-3)
        free, _ = kept(x, before, DetailedMpc())
        assert np.abs(free[0] - before).max() > 0.1


def test_no_servo_is_asked_to_even_where_a_speed_limit_cannot_be_kept():
    slow, before = DetailedMpc(model=DetailedModel(servo_slew=2.5)), np.array([0.0, 0.0, 0.55, 0.0])
    estimate = Estimate(0, np.array([0, 0, 1.0, 0, 4.0, 0, 0, 0]), np.zeros(4), np.zeros((4, 3)), 0, 0, np.zeros(12))
    flat = np.zeros((6, slow.steps + 1, 4))
    controller = slow.start()
    command = controller.explain(
        controller.step(0, estimate, Reference(0, flat[0] @ np.zeros((4, 8)), flat[0, :-1], flat))
    )
    assert command.qp is not None
    assert command.plan is not None
    assert command.qp.status == "softened"
    assert np.abs(np.diff(command.plan.u, axis=0, prepend=before[None]))[:, :2].max() < 0.05 + 1e-4


def test_a_quick_start_ends_where_it_should_and_not_in_a_limit_cycle(tmp_path):
    step = ["trajectory=waypoints", "trajectory.points=[[0,0,1,0],[0.06,0.15,1,0]]", "trajectory.times=[0,0.96]"]

    def swing(*overrides: str) -> float:
        _, log = flown(tmp_path, load("detailed", [*step, "duration=5", *overrides]))
        late = log.truth.seconds > 3.0
        return float(np.abs(log.truth.position - log.reference.position)[late].max())

    assert swing() < 0.03
    # Full stick to and fro, which the servos are too slow for: the law has to know.
    assert swing("controller.model.servo_slew=10000") > 0.15


@dataclass(frozen=True)
class Step:
    """A step of 1.5 m, which no helicopter can follow."""

    kind: Literal["step"] = "step"

    def flat(self, t: Array) -> FlatOutput:
        z = np.zeros((len(t), 4))
        z[:, 0], z[:, 2] = np.where(t >= 1.0, 0.75, -0.75), 1.0
        return FlatOutput(z, 0 * z, 0 * z)


@pytest.mark.parametrize(("terminal", "largest"), [("paper", 0.09), ("riccati", 0.06)])
def test_integral_states_do_not_wind_up_on_a_step(tmp_path, terminal, largest):
    def overshoot(zone: float) -> float:
        law = replace(LtvMpc(), terminal=terminal, integral_zone=zone)
        flight = replace(load("ideal", ["duration=6"]), trajectory=Step(), controller=law)
        return float(flown(tmp_path, flight)[1].truth.position[:, 0].max() - 0.75)

    assert overshoot(0.3) < largest
    assert overshoot(1e9) > 2.0 * largest


def test_a_derivative_of_the_error_does_not_brake_a_moving_reference(tmp_path):
    def rms(law: Pid) -> float:
        summary, _ = flown(tmp_path, replace(load("ideal", ["duration=8"]), controller=law))
        return summary["rmse"]["x"]

    braked, free = rms(Pid()), rms(Pid(derivative="error"))
    assert free < 0.4 * braked
    # Both of the error: with the planned inputs as well, it errs least.
    assert rms(Pid(feed_forward="flat")) < free


def test_a_detailed_model_has_the_roll_frequency_of_the_twin():
    assert DetailedModel().roll_frequency == pytest.approx(14.0 * np.sqrt(3.9 / 2.8), rel=2e-3)
