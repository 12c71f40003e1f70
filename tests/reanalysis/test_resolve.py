"""Logged control problems solved again give the logged inputs; other controllers give counterfactual ones."""

from pathlib import Path

import numpy as np
import pytest

from controllers.laws.ltv_mpc import LtvMpcController
from controllers.reference import ReferencePreview
from controllers.signals import Estimate, nanoseconds
from heli_twin import HeliTwinError, fly, load, read_log
from heli_twin.cli import main
from heli_twin.logbook import flown_experiment
from heli_twin.reanalysis.resolve import resolve, write
from heli_twin.recording import Log


def _flight(*overrides: str) -> Log:
    return fly(load("lab", ["duration=2", *overrides]), log_dir=None).log


@pytest.fixture(scope="module")
def mpc() -> Log:
    return _flight()


@pytest.fixture(scope="module")
def pid() -> Log:
    return _flight("controller=pid")


def test_a_resolved_qp_gives_the_logged_input_to_the_last_bit(mpc: Log) -> None:
    again = resolve(mpc)
    assert len(again.commands) == len(mpc.estimate.time)
    np.testing.assert_array_equal(again.u, mpc.sent.u[-len(again.u) :])
    np.testing.assert_array_equal(again.difference, 0.0)


@pytest.mark.parametrize("k", [1, 37, 95])
def test_one_logged_qp_alone_gives_the_logged_input(mpc: Log, k: int) -> None:
    experiment = flown_experiment(mpc)
    law, lead = experiment.controller, nanoseconds(experiment.estimator.lead)
    controller = law.start()
    assert isinstance(controller, LtvMpcController)
    preview = ReferencePreview(experiment.trajectory, law.model, nanoseconds(law.period), lead)
    estimates = [Estimate(int(row[0]), *row[1:]) for row in zip(*mpc.estimate[1:], strict=True)]
    for estimate in estimates[:k]:
        # The integral states follow from the estimates; no problem is solved.
        controller.problem(estimate, preview(estimate.stamp, law.steps))
    controller.linearise_along(mpc.plan.u_nominal[k])
    command = controller.step(0, estimates[k], preview(estimates[k].stamp, law.steps))
    sent = np.flatnonzero(mpc.sent.time == mpc.estimate.time[k])
    np.testing.assert_array_equal(command.u, mpc.sent.u[sent[0]])


def test_a_resolved_qp_gives_the_logged_plan(mpc: Log) -> None:
    plans = [command.plan for command in resolve(mpc).commands]
    u = np.array([plan.u for plan in plans if plan])
    np.testing.assert_array_equal(u, mpc.plan.u)
    u_nominal = np.array([plan.u_nominal for plan in plans if plan])
    np.testing.assert_array_equal(u_nominal, mpc.plan.u_nominal)


def test_a_pid_answers_as_it_did_to_the_last_digit(pid: Log) -> None:
    np.testing.assert_array_equal(resolve(pid).difference, 0.0)


@pytest.mark.parametrize(
    "override",
    [
        "controller.horizon=10",
        "controller.horizon=25",
        "controller.coupling=full",
        "controller.discretisation=exact",
        "controller.R=[20.0, 20.0, 20.0, 20.0]",
    ],
)
def test_another_controller_answers_to_the_same_moments(mpc: Log, override: str) -> None:
    other = resolve(mpc, [override])
    np.testing.assert_array_equal(other.time, mpc.estimate.time)
    assert np.abs(other.difference).max() > 1e-6
    assert {command.qp.status for command in other.commands if command.qp} == {"solved"}
    assert {len(command.plan.u) for command in other.commands if command.plan} == {other.experiment.controller.steps}


def test_counterfactuals_keep_the_flown_nominal_inputs(mpc: Log) -> None:
    plans = [command.plan for command in resolve(mpc, ["controller.horizon=10"]).commands]
    np.testing.assert_array_equal([plan.u_nominal for plan in plans if plan], mpc.plan.u_nominal[:, :11])


def test_the_mpc_shadows_a_pid_and_believes_what_it_believed() -> None:
    pid = _flight("controller=pid", "controller.model.b_z=17.5")
    shadow = resolve(pid, ["controller.kind=ltv_mpc", "controller.horizon=12"])
    assert shadow.experiment.controller.model.b_z == 17.5
    assert len(shadow.commands[0].plan.u if shadow.commands[0].plan else ()) == 13
    # Feedback differs, hovering thrust does not.
    assert 0 < np.abs(shadow.difference[:, 2]).max() < 0.1


def test_the_new_log_has_new_inputs_and_all_else_as_flown(mpc: Log, tmp_path: Path) -> None:
    other = resolve(mpc, ["controller.horizon=10"])
    write(mpc, other, tmp_path / "other.mcap")
    log = read_log(tmp_path / "other.mcap")
    np.testing.assert_array_equal(log.sent.u, other.u)
    assert log.plan.u.shape[1:] == (11, 4)
    for topic in ("/truth", "/mocap/pose", "/estimate", "/reference", "/command/acting", "/disturbance", "/tf"):
        assert list(log.messages[topic].times) == list(mpc.messages[topic].times), topic
        assert [*map(bytes, log.messages[topic].data)] == [*map(bytes, mpc.messages[topic].data)], topic
    assert log.outcome == mpc.outcome
    assert log.metadata["resolved_from"] == mpc.digest


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("plant.mass=0.03", "controller"),
        ("controller.period=0.04", "0.02 s"),
        ("controller.horizn=3", "controller.horizon"),
        ("horizon", "'horizon' is not an override: write path=value, such as controller.horizon=12"),
    ],
)
def test_what_cannot_be_resolved_is_refused_in_one_sentence(mpc: Log, override: str, message: str) -> None:
    with pytest.raises(HeliTwinError, match=message):
        resolve(mpc, [override])


def test_a_log_without_estimates_is_refused() -> None:
    with pytest.raises(HeliTwinError, match="no estimates"):
        resolve(Log({}, experiment="{}"))


def test_the_command_writes_the_counterfactual_beside_the_flight(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = fly(load("lab", ["duration=1"]), log_dir=tmp_path).path
    assert main(["resolve", str(path)]) == 0
    assert "bit for bit" in capsys.readouterr().out
    assert len(list(tmp_path.iterdir())) == 1
    assert main(["resolve", str(path), "controller.coupling=full"]) == 0
    assert len(list(tmp_path.glob("*.resolved.mcap"))) == 1
