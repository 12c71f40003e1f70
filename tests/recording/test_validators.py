"""Independent programs read a log, each with its own parser."""

import json
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from heli_twin.recording import Recorder, read_log

Record = Callable[..., Recorder]

CHECK = Path(__file__).with_name("check_log.mjs")
PACKAGES = {"@mcap/core": "^2.2.2", "@mcap/nodejs": "^1.0.2", "@foxglove/wasm-zstd": "^1.0.1"}


@pytest.fixture(scope="module")
def run(record: Record, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("run") / "run.mcap", seconds=1.3).path


@pytest.fixture(scope="module")
def flipped(run: Path) -> Path:
    damaged = bytearray(run.read_bytes())
    damaged[len(damaged) // 2] ^= 4
    run.with_name("flipped.mcap").write_bytes(damaged)
    return run.with_name("flipped.mcap")


def tool(name: str, *arguments: object, **options) -> subprocess.CompletedProcess[str]:
    command = [Path(sys.executable).with_name(name), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


def test_rerun_finds_nothing_wrong(run: Path) -> None:
    check = tool("rerun", "mcap", "check", "--full", run)
    assert check.returncode == 0, check.stdout + check.stderr
    verdicts = [line.split()[0] for line in check.stdout.splitlines() if " /" in line]
    assert set(verdicts) == {"ok"}, check.stdout


def test_pymcap_doctor_finds_nothing_wrong(run: Path, flipped: Path) -> None:
    check = tool("pymcap-cli", "doctor", run)
    assert check.returncode == 0, check.stdout + check.stderr
    assert tool("pymcap-cli", "doctor", flipped).returncode != 0


def test_rosbags_reads_the_ros_topics(run: Path) -> None:
    types = get_typestore(Stores.ROS2_HUMBLE)
    read: dict[str, list] = {}
    with run.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if channel.message_encoding == "cdr":
                assert schema is not None
                read.setdefault(channel.topic, []).append(types.deserialize_cdr(message.data, schema.name))
    (shape,) = read["/robot_description"]
    assert shape.data.startswith("<robot")
    log = read_log(run)
    sent = dict(zip(log.sent.time.tolist(), log.sent.u, strict=True))
    for joints in read["/view/error_and_input"]:
        stamp = joints.header.stamp
        np.testing.assert_array_equal(joints.effort, sent[stamp.sec * 10**9 + stamp.nanosec])
        assert len(joints.name) == len(joints.position) == len(joints.velocity) == 4


def test_the_typescript_library_agrees_by_index_and_by_stream(run: Path, flipped: Path, tmp_path: Path) -> None:
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        pytest.skip("there is no node")
    (tmp_path / "package.json").write_text(json.dumps({"private": True, "dependencies": PACKAGES}))
    shutil.copy(CHECK, tmp_path)
    install = [npm, "install", "--no-audit", "--no-fund", "--ignore-scripts", "--fetch-retries=0"]
    try:
        subprocess.run(install, cwd=tmp_path, capture_output=True, timeout=60, check=True)
    except subprocess.SubprocessError:
        pytest.skip("npm cannot install the library here")
    check = subprocess.run([node, CHECK.name, run], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert check.returncode == 0, check.stdout + check.stderr
    counts = {topic: len(messages.times) for topic, messages in read_log(run).messages.items() if len(messages.times)}
    assert Counter(json.loads(check.stdout)["topics"]) == Counter(counts)
    assert subprocess.run([node, CHECK.name, flipped], cwd=tmp_path, capture_output=True, check=False).returncode != 0
