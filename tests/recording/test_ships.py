"""A foreign log of several helicopters gives what it holds, or one sentence."""

from collections.abc import Callable
from io import BytesIO

import numpy as np
import pytest

from heli_twin.experiment.several_text import load_several
from heli_twin.recording import Log, LogError, read_log, ships_pb2
from heli_twin.recording.mcap_stream import McapStream
from heli_twin.recording.schema import sealed, topics_of
from heli_twin.several.fly import fly_several

KNOTS = np.zeros((3, 3, 4)).ravel().tolist()


@pytest.fixture(scope="module")
def log() -> Log:
    return fly_several(load_several("pair", ["coordination=none", "duration=0.1"]), log_dir=None).log


def rebuilt(log: Log, ships: str = "a,b", path: bytes | None = None, experiment: Callable[[str], bool] = bool) -> Log:
    """The same log with other names, another plan, or without the experiments of some helicopters."""
    stream = BytesIO()
    file = McapStream(stream, library="heli_twin", chunk_size=1 << 18)
    file.metadata("heli_twin", {"format": "2", "ships": ships})
    file.metadata("run", sealed(log.metadata))
    for name, attachment in log.attachments.items():
        if name == "experiment.json" or experiment(name):
            file.attachment(*attachment)
    channels = {topic.name: file.channel(*topic) for topic in topics_of([*log.ships])}
    for topic, messages in log.messages.items():
        for t, data in zip(messages.times, messages.data, strict=True):
            file.message(channels[topic], t, path if topic == "/a/path" and path is not None else bytes(data))
    file.finish()
    return read_log(stream)


def test_what_is_rebuilt_is_the_log(log: Log):
    again = rebuilt(log)
    assert again.messages == log.messages
    assert [*again.ships] == ["a", "b"]
    assert again.ship("a").outcome == "unknown"


@pytest.mark.parametrize("ships", ["a,../x", "a,b c", "a,\x1b[31m", "9a"])
def test_names_that_cannot_be_are_refused(log: Log, ships: str):
    with pytest.raises(LogError, match=r"names a helicopter that cannot be: .* is not a name") as error:
        rebuilt(log, ships)
    assert "\x1b" not in str(error.value)


def test_a_helicopter_without_an_experiment_is_told(log: Log):
    with pytest.raises(LogError, match="does not say what c flew"):
        rebuilt(log, "a,b,c").ship("c")
    with pytest.raises(LogError, match="does not say what a flew"):
        rebuilt(log, experiment=lambda name: not name.startswith("a/")).ship("a")


@pytest.mark.parametrize(
    "message",
    [
        ships_pb2.Path(start=0, step=5, knots=KNOTS[:-1]),
        ships_pb2.Path(start=0, step=5, knots=KNOTS[:12]),
        ships_pb2.Path(start=0, step=-5, knots=KNOTS),
        ships_pb2.Path(start=0, step=5, knots=[float("nan"), *KNOTS[1:]]),
        None,
    ],
)
def test_a_plan_that_is_none_is_told(log: Log, message: ships_pb2.Path | None):
    data = b"\xff\xff" if message is None else message.SerializeToString()
    with pytest.raises(LogError, match="the messages on /path cannot be read"):
        _ = rebuilt(log, path=data).ship("a").committed
