"""A log says what its wires were told."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from controllers.signals import NU, NX, Command, Estimate, Plan, Pose, QpReport, Reference
from heli_twin.lab.plant import Air, Truth
from heli_twin.recording import Attachment, Event, Log, LogError, Recorder
from heli_twin.recording.schema import QP_STATUS, SEAL, SEVERITIES
from heli_twin.recording.state_names import named, trouble_with

NS = st.integers(0, 2**62)
STAMP = st.integers(-1, 2**62)
REAL = st.floats()
COUNT = st.integers(0, 2**31 - 1)


def vector(*shape: int) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.float64, shape, elements=REAL)


def logged(**wires: tuple) -> Log:
    with Recorder() as recorder:
        for wire, arguments in wires.items():
            getattr(recorder, wire)(*arguments)
    return recorder.log()


def assert_same(columns: tuple, time: int, *values: object) -> None:
    assert columns[0].tolist() == [time]
    for column, value in zip(columns[1:], values, strict=True):
        np.testing.assert_array_equal(column[0], value, strict=isinstance(value, np.ndarray))


TRUTHS = st.builds(Truth, NS, vector(3), vector(4), vector(3), vector(3), REAL, REAL, vector(4), touching=st.booleans())


@given(NS, TRUTHS)
def test_truth(t: int, truth: Truth) -> None:
    assert_same(logged(truth=(t, truth)).truth, t, *truth)


@given(NS, st.builds(Pose, NS, vector(3), vector(4)))
def test_pose(t: int, pose: Pose) -> None:
    assert_same(logged(pose=(t, pose)).pose, t, *pose)


@given(NS, st.builds(Estimate, NS, vector(NX), vector(NU), vector(4, 3), STAMP, COUNT, vector(0), vector(0)))
def test_estimate(t: int, estimate: Estimate) -> None:
    assert_same(logged(estimate=(t, estimate)).estimate, t, *estimate[:6])


@given(NS, st.builds(Reference, NS, vector(4, NX), vector(3, NU), st.none()))
def test_reference(t: int, reference: Reference) -> None:
    assert_same(logged(reference=(t, reference)).reference, t, reference.stamp, reference.x[0], reference.u[0])


@given(NS, st.builds(Command, NS, vector(NU)))
def test_commands(t: int, command: Command) -> None:
    log = logged(sent=(t, command), acting=(t, command.u, command.stamp))
    assert_same(log.sent, t, command.stamp, command.u)
    assert_same(log.acting, t, command.stamp, command.u)


def test_an_input_nobody_decided_has_no_stamp() -> None:
    assert logged(acting=(5, np.zeros(NU))).acting.stamp.tolist() == [-1]


PLANS = st.integers(1, 5).flatmap(lambda n: st.builds(Plan, vector(n + 1, 10), vector(n, NU), vector(n, NU), st.none()))


@given(NS, PLANS)
def test_plan(t: int, plan: Plan) -> None:
    with np.errstate(over="ignore"):
        rounded = plan.x.astype(np.float32)
    assert_same(logged(plan=(t, plan)).plan, t, rounded, plan.u, plan.u_nominal)


@given(NS, st.builds(QpReport, st.sampled_from(QP_STATUS[1:]), COUNT, COUNT, REAL, REAL))
def test_qp(t: int, report: QpReport) -> None:
    assert_same(logged(qp=(t, report)).qp, t, *report)


@given(NS, st.builds(Air, vector(3), vector(3), REAL, st.none()))
def test_disturbance(t: int, air: Air) -> None:
    assert_same(logged(disturbance=(t, air)).disturbance, t, *air[:3])


@given(NS, st.builds(Air, vector(3), vector(3), REAL, vector(3)))
def test_disturbance_with_a_moment(t: int, air: Air) -> None:
    log = logged(disturbance=(t, air))
    assert_same(log.disturbance, t, *air[:3])
    assert_same(log.disturbance_moment, t, air.moment)


@given(NS, st.builds(Estimate, NS, vector(NX), vector(NU), vector(4, 3), STAMP, COUNT, vector(3), vector(3)))
def test_further_states_of_an_estimate(t: int, estimate: Estimate) -> None:
    log = logged(estimate=(t, estimate))
    assert_same(log.estimate, t, *estimate[:6])
    assert_same(log.estimate_extra, t, estimate.stamp, *estimate[6:])
    assert [state.name for state in log.estimate_states] == ["state_0", "state_1", "state_2"]


@given(NS, st.integers(1, 5), st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_further_states_of_a_plan(t: int, n: int, k: int, seed: int) -> None:
    draw = np.random.default_rng(seed).standard_normal
    plan = Plan(draw((n + 1, NX)), draw((n, NU)), draw((n, NU)), draw((n + 1, k)))
    log = logged(plan=(t, plan))
    np.testing.assert_array_equal(log.plan.x[0, :, :NX], plan.x.astype(np.float32))
    np.testing.assert_array_equal(log.plan.x[0, :, NX:], 0.0)
    assert_same(log.plan_extra, t, plan.extra.astype(np.float32))


def test_the_number_of_further_states_stays_the_same_in_a_flight() -> None:
    with Recorder() as recorder:
        recorder.estimate(0, Estimate(0, np.zeros(8), np.zeros(4), np.zeros((4, 3)), 0, 0, np.zeros(2)))
        with pytest.raises(LogError, match="changes within the flight"):
            recorder.estimate(1, Estimate(0, np.zeros(8), np.zeros(4), np.zeros((4, 3)), 0, 0, np.zeros(3)))
    assert np.isnan(recorder.log().estimate_extra.variance).all()


@given(st.text() | st.just('[["time","s"],["a","m"],["a","m"],["tilt","rad"],[1,2],null]'), st.integers(0, 8))
def test_foreign_names_of_states_become_names_that_differ(text: str, count: int) -> None:
    states = named(text, count)
    assert len({state.name for state in states}) == count
    assert not trouble_with([state for state in states if not state.name.startswith("state_")])


@given(st.builds(Event, NS, st.sampled_from(SEVERITIES[1:]), st.text(), st.text()))
def test_event(event: Event) -> None:
    assert logged(event=event).events == [event]


@given(NS, NS, NS)
def test_timing(t: int, step: int, solve: int) -> None:
    assert_same(logged(timing=(t, step, solve)).timing, t, step, solve)


@given(st.text(), st.dictionaries(st.text().filter(lambda key: key != SEAL), st.text()), st.binary())
def test_what_is_known_before_the_flight(experiment: str, metadata: dict[str, str], data: bytes) -> None:
    model = Attachment("model.xml", "application/xml", data)
    recorder = Recorder(experiment=experiment, metadata=metadata, attachments=[model])
    recorder.close("completed", 7, "flew")
    log = recorder.log()
    assert (log.experiment, log.metadata, log.attachments["model.xml"]) == (experiment, metadata, model)
    assert (log.outcome, log.ending.time, log.ending.text) == ("completed", 7, "flew")
    assert log.digest == recorder.digest


def test_a_silent_wire_has_empty_columns_of_the_right_shape() -> None:
    log = logged()
    assert log.truth.position.shape == (0, 3)
    assert log.estimate.variance.shape == (0, 4, 3)
    assert log.plan.u.shape == (0, 0, 4)
    assert log.qp.status.shape == (0,)
    assert log.events == []
