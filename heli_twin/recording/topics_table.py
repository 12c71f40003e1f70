"""The guide's table of topics, made from the `.proto` file and the schema."""

import re
from collections.abc import Iterator
from typing import NamedTuple

from heli_twin.recording.schema import FOR_VIEWERS, LATER_WIRES, WIRES, Topic, proto

ABOUT = {
    "/events": "what was worth telling a person: severity, name, one sentence",
    "/robot_description": "the shape of the helicopter, a URDF whose one moving link is `helicopter`",
    "/tf": "where the helicopter is, by the cameras if nobody knows the truth; thinned out",
    "/view/reference_path": "the whole path to fly, white",
    "/view/horizon": "the positions of the latest plan, orange, thinned out",
    "/view/error_and_input": "position: truth minus reference of x y z (world, m) and yaw (rad); velocity: the same of"
    " vx vy vz (yaw frame, m/s) and yaw rate (rad/s); effort: the inputs; thinned out",
}
"""Descriptions of the topics whose message types are not defined in `flight.proto`."""


class Field(NamedTuple):
    """One field of one message type in `flight.proto`."""

    message: str
    name: str
    comment: str
    """Unit, and the frame of a vector."""


def fields() -> Iterator[Field]:
    """Each field of the `.proto` file, in order."""
    text = proto().decode()
    for message, body in re.findall(r"^message (\w+) \{\n(.*?)^\}", text, re.MULTILINE | re.DOTALL):
        for name, comment in re.findall(r"^  \w+ \w+ (\w+) = \d+; *(?:// (.*))?$", body, re.MULTILINE):
            yield Field(message, name, comment)


def about() -> dict[str, str]:
    """One sentence for each topic."""
    comments = re.findall(r"^// Topic (/\S+): ((?:.*\n)(?:// (?!Topic ).*\n)*)", proto().decode(), re.MULTILINE)
    return ABOUT | {topic: text.replace("\n// ", " ").strip().removesuffix(".") for topic, text in comments}


def topics_table() -> str:
    """A Markdown table of all topics in the order data flows."""
    said = about()
    wires, views = (
        [f"| `{topic.name}` | {said[topic.name]} | {_message(topic)} |" for topic in topics]
        for topics in (WIRES + LATER_WIRES, FOR_VIEWERS)
    )
    head = ["| topic | what it says | message |", "|---|---|---|"]
    between = "| | *for viewers that know nothing of heli_twin, derived from the topics above:* | |"
    return "\n".join([*head, *wires, between, *views])


def _message(topic: Topic) -> str:
    kind = "CDR" if topic.message_encoding == "cdr" else "protobuf"
    return f"`{topic.schema_name.removeprefix('heli_twin.v1.')}`, {kind}"


if __name__ == "__main__":
    print(topics_table())
