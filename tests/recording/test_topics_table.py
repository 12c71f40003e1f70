"""The contract for people: every field says its unit and frame, and the guide says every topic."""

import re
from pathlib import Path

import pytest

import heli_twin.recording
from heli_twin.recording import flight_pb2 as pb
from heli_twin.recording.schema import FORMAT_OF_ONE, TOPICS
from heli_twin.recording.topics_table import Field, about, fields, topics_table

PAGE = Path(heli_twin.recording.__file__).parents[1] / "guide" / "logs.md"
UNITS = {
    "V",
    "A",
    "ns",
    "m",
    "m/s",
    "m/s^2",
    "rad",
    "rad/s",
    "rad/s^2",
    "unit",
    "count",
    "fraction",
    "fractions",
    "squared",
}
FRAMES = re.compile(r"\b(world|body|yaw frame)\b")
SPATIAL = {"position", "quat_wxyz", "velocity", "angular_velocity", "wind", "acceleration", "variance", "disturbance"}


def test_every_field_is_described() -> None:
    described = {(field.message, field.name) for field in fields() if field.comment}
    assert described == {
        (name, field.name) for name, message in pb.DESCRIPTOR.message_types_by_name.items() for field in message.fields
    }


@pytest.mark.parametrize("field", [*fields()], ids=lambda field: f"{field.message}.{field.name}")
def test_every_field_says_its_unit_and_frame(field: Field) -> None:
    assert set(re.findall(r"[\w/^]+", field.comment)) & UNITS, field
    assert field.name not in SPATIAL or FRAMES.search(field.comment), field


def test_every_topic_is_described() -> None:
    assert set(about()) == {topic.name for topic in TOPICS}


def test_the_guide_holds_the_table_of_topics() -> None:
    page = PAGE.read_text(encoding="utf-8")
    table = re.search("<!-- topics -->\n(.*)\n<!-- /topics -->", page, re.DOTALL)
    assert table, "guide/logs.md has lost its <!-- topics --> and <!-- /topics --> marks"
    assert table[1] == topics_table(), "put what `python -m heli_twin.recording.topics_table` prints between the marks"
    assert f"Log format {FORMAT_OF_ONE}:" in page
