"""The contract: generated code is up to date, messages mirror the signals, packing equals protobuf."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import heli_twin.recording
from controllers.signals import Estimate, Plan, Pose, QpReport
from heli_twin.lab.plant import Air, Battery, Truth
from heli_twin.recording import flight_pb2 as pb
from heli_twin.recording import log
from heli_twin.recording.packing import Layout
from heli_twin.recording.schema import (
    LAYOUTS,
    QP_STATUS,
    SEVERITIES,
    TOPICS,
    extra_estimate_layout,
    extra_plan_layout,
    plan_layout,
)

ROOT = Path(heli_twin.recording.__file__).parents[2]
PROTOS = ("heli_twin/recording/flight.proto", "heli_twin/recording/ships.proto")
GENERATOR = re.compile("^# Protobuf Python Version: (.*)", re.MULTILINE)
DESCRIPTOR = re.compile("^DESCRIPTOR = .*", re.MULTILINE)
"""The part that does not depend on the version of the generator."""
COMMAND = "python -m grpc_tools.protoc -I. --python_out=. --pyi_out=."


@pytest.mark.parametrize("proto", PROTOS)
def test_generated_code_is_up_to_date(tmp_path: Path, proto: str) -> None:
    options = [f"-I{ROOT}", f"--python_out={tmp_path}", f"--pyi_out={tmp_path}", str(ROOT / proto)]
    stem = Path(proto).stem
    subprocess.run([sys.executable, "-m", "grpc_tools.protoc", *options], check=True)
    (committed, stub), (fresh, fresh_stub) = (
        [(top / proto).with_name(name).read_text() for name in (f"{stem}_pb2.py", f"{stem}_pb2.pyi")]
        for top in (ROOT, tmp_path)
    )
    again = f"{stem}_pb2.py is not what {proto} gives: run `{COMMAND} {proto}` at the top of the repository"
    assert GENERATOR.findall(committed) == ["6.31.1"], "generate with grpcio-tools 1.75: protobuf from 6.31 on reads it"
    assert DESCRIPTOR.findall(committed) == DESCRIPTOR.findall(fresh), again
    if GENERATOR.findall(fresh) == ["6.31.1"]:
        assert (committed, stub) == (fresh, fresh_stub), again


LATER = {Estimate: ("extra", "extra_variance"), Plan: ("extra",), Air: ("moment",)}


@pytest.mark.parametrize(
    ("message", "signal"),
    [
        (pb.Truth, Truth),
        (pb.Pose, Pose),
        (pb.Estimate, Estimate),
        (pb.Plan, Plan),
        (pb.QpReport, QpReport),
        (pb.Air, Air),
        (pb.Battery, Battery),
    ],
)
def test_messages_have_the_fields_of_the_signals(message: type, signal: type) -> None:
    names = tuple(field.name for field in message.DESCRIPTOR.fields)
    # What most flights do not have, a moment and further states, stands on topics of its own.
    assert names + LATER.get(signal, ()) == signal._fields


@pytest.mark.parametrize(
    ("topic", "columns"),
    [
        ("/truth", log.Truths),
        ("/mocap/pose", log.Poses),
        ("/estimate", log.Estimates),
        ("/reference", log.References),
        ("/command/sent", log.Commands),
        ("/command/acting", log.Commands),
        ("/mpc/plan", log.Plans),
        ("/mpc/qp", log.QpReports),
        ("/disturbance", log.Airs),
        ("/timing", log.Timings),
        ("/battery", log.Batteries),
        ("/disturbance_moment", log.Moments),
        ("/estimate_extra", log.ExtraEstimates),
        ("/mpc/plan_extra", log.ExtraPlans),
    ],
)
def test_columns_have_the_fields_of_the_messages(topic: str, columns: type) -> None:
    sized = {"/mpc/plan": plan_layout(3), "/estimate_extra": extra_estimate_layout(2)}
    layout = {**LAYOUTS, **sized, "/mpc/plan_extra": extra_plan_layout(4, 2)}[topic]
    assert columns._fields == ("time", *layout.dtype.names)


def test_names_of_enums_are_those_of_the_signals() -> None:
    assert QP_STATUS[1:] == ("solved", "softened", "shifted_plan", "safe_hover")
    assert SEVERITIES[1:] == ("debug", "info", "warning", "error", "fatal")


def test_every_topic_stands_once() -> None:
    assert len({topic.name for topic in TOPICS}) == len(TOPICS)


FLOATS = st.floats(allow_nan=False, width=32)
NS = st.integers(-(2**63), 2**63 - 1)
COUNT = st.integers(-(2**31), 2**31 - 1)


@given(NS, arrays(float, 3, elements=FLOATS), arrays(float, (4, 3), elements=FLOATS), COUNT, st.booleans(), FLOATS)
def test_packing_equals_protobuf(stamp: int, three: np.ndarray, many: np.ndarray, n: int, flag: bool, x: float) -> None:
    four = many[:, 0]
    truth = (stamp, three, four, -three, 2 * three, x, -x, four, flag)
    estimate = (stamp, np.append(many[1], [x] * 5), four, many, -1, n)
    for message, topic, values in [
        (pb.Truth, "/truth", truth),
        (pb.Estimate, "/estimate", estimate),
        (pb.QpReport, "/mpc/qp", (n % 5, n, -1, x, -x)),
        (pb.Timing, "/timing", (stamp, 0)),
    ]:
        assert LAYOUTS[topic].pack([values]) == [_protobuf(message, values)]


@given(st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_packing_a_plan_equals_protobuf(horizon: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    plan = Plan(
        rng.standard_normal((horizon + 1, 10)), rng.standard_normal((horizon, 4)), rng.standard_normal((horizon, 4))
    )
    assert plan_layout(horizon).pack([plan[:3]]) == [_protobuf(pb.Plan, plan[:3])]


def _protobuf(message: type, values: tuple) -> bytes:
    fields = (field.name for field in message.DESCRIPTOR.fields)
    plain = (value.ravel().tolist() if isinstance(value, np.ndarray) else value for value in values)
    return message(**dict(zip(fields, plain, strict=True))).SerializeToString()


@pytest.mark.parametrize("damage", [lambda data: data[:-1], lambda data: b"\x08" + data[1:]])
def test_unpacking_refuses_other_messages(damage) -> None:
    layout = Layout(pb.Pose, position=(3,), quat_wxyz=(4,))
    (data,) = layout.pack([(1, np.zeros(3), np.zeros(4))])
    with pytest.raises(ValueError, match="a message"):
        layout.unpack([data, damage(data)])
