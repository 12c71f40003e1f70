"""Pictures: the same live and replayed, and never in the way of a flight."""

import os
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from threading import Event, Thread

import numpy as np
import pytest

from controllers.signals import Pose
from heli_twin.recording import Log, LogError, Recorder
from heli_twin.requirements import requirements_of
from heli_twin.viewing import delivery, viewer_process
from heli_twin.viewing.blueprint import Scales
from heli_twin.viewing.live import Destination, Live, show
from heli_twin.viewing.requirements import judged
from heli_twin.viewing.viewer_process import headless

Record = Callable[..., Recorder]

RERUN = Path(sys.executable).with_name("rerun")
SCALES = Scales(path=np.array([[0.0, 0.0, 1.0], [1.0, 1.0, 1.0]]))


@pytest.fixture
def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def rerun(*arguments: object) -> None:
    run = subprocess.run([RERUN, *map(str, arguments)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr


def test_live_equals_replay(record: Record, tmp_path: Path) -> None:
    required = requirements_of({"near": "always error.position < 1 cm", "late": "always[9s,end] touching"})
    live = Live(Destination(tmp_path / "live.rrd"), SCALES._replace(required=required))
    recorder = record(seconds=2.3, listeners=[live])
    live.judge(BytesIO(recorder.stream.getvalue()))
    live.close()
    found = judged(required, recorder.log())
    show(recorder.log(), Destination(tmp_path / "replay.rrd"), SCALES, found=found)
    for name in ("live", "replay"):
        rerun("rrd", "optimize", tmp_path / f"{name}.rrd", "-o", tmp_path / f"{name}.whole.rrd")
    rerun("rrd", "compare", "--unordered", tmp_path / "live.whole.rrd", tmp_path / "replay.whole.rrd")


def test_the_file_is_whole(record: Record, tmp_path: Path) -> None:
    show(record(seconds=0.5).log(), Destination(tmp_path / "run.rrd"), SCALES)
    rerun("rrd", "verify", tmp_path / "run.rrd")


@pytest.mark.parametrize("wires", [{}, {"pose": (0, Pose(0, np.zeros(3), np.zeros(4)))}])
def test_a_flight_with_silent_wires_is_shown(wires: dict[str, tuple], tmp_path: Path) -> None:
    with Recorder() as recorder:
        for wire, arguments in wires.items():
            getattr(recorder, wire)(*arguments)
    show(recorder.log(), Destination(tmp_path / "run.rrd"), SCALES)
    rerun("rrd", "verify", tmp_path / "run.rrd")


def test_a_missing_viewer_is_told_and_does_not_stop_the_flight(
    record: Record, free_port: int, caplog: pytest.LogCaptureFixture
) -> None:
    live = Live(Destination(port=free_port), SCALES)
    record(seconds=1.2, listeners=[live])
    live.close()
    (told,) = caplog.records
    assert f"no viewer listens on port {free_port}: start one with" in told.getMessage()


def test_a_viewer_that_dies_does_not_stop_the_flight(record: Record, free_port: int, tmp_path: Path) -> None:
    viewer = subprocess.Popen(
        [RERUN, "--serve-grpc", "--bind", "127.0.0.1", "--port", str(free_port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        # What is killed leaves its cache behind.
        env=os.environ | {"TMPDIR": str(tmp_path)},
        start_new_session=True,
    )
    try:
        _wait_for(free_port)
        live = Live(Destination(port=free_port), SCALES)
        record(seconds=0.8, listeners=[live])
    finally:
        os.killpg(viewer.pid, signal.SIGKILL)
        viewer.wait()
    record(seconds=1.2, listeners=[live])
    live.close()


MUTE = """
import socket, sys, time
from pathlib import Path
from heli_twin.recording import Recorder
from heli_twin.viewing import delivery, live
from heli_twin.viewing.blueprint import Scales
import numpy as np
from controllers.signals import Pose
live.SHUTDOWN_TIMEOUT_S = 0.2
mute = socket.create_server(("127.0.0.1", 0))
began = time.monotonic()
pictures = live.Live(delivery.Destination(port=mute.getsockname()[1]), Scales())
with Recorder(listeners=[pictures]) as recorder:
    for t in range(0, 200 * 10**9, 20_000_000):
        recorder.pose(t, Pose(t, np.zeros(3), np.zeros(4)))
pictures.close()
print(len(recorder.log().pose.time), time.monotonic() - began)
"""


def test_a_viewer_that_hangs_holds_up_neither_the_flight_nor_the_end_of_the_program() -> None:
    """It takes connections and says nothing; 200 s of flight are twice what waits for it."""
    command, paths = [sys.executable, "-c", MUTE], {"PYTHONPATH": ":".join(sys.path)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True, env=paths)
    recorded, seconds = done.stdout.split()
    assert int(recorded) == 10_000
    assert float(seconds) < 30
    assert done.stderr.count("does not answer: the picture has gaps") == 1


REPLAY = """
import socket, sys
from threading import Event, Thread
from heli_twin.viewing import show
from heli_twin.cli import main
from heli_twin.viewing import delivery
delivery.ANSWER_TIMEOUT_S = 0.5
server = socket.create_server(("127.0.0.1", 0))
show.VIEWER_PORT = server.getsockname()[1]
def serve():
    while True:
        connection, _ = server.accept()
        # As a viewer greets.
        connection.sendall(bytes([0, 0, 0, 4, 0, 0, 0, 0, 0]))
        connections.append(connection) if sys.argv[2] == "hangs" else connection.close()
connections = []
Thread(target=serve, daemon=True).start()
sys.exit(main(["replay", sys.argv[1], "--connect"]))
"""


@pytest.mark.parametrize(
    ("viewer", "sentence"), [("hangs", "does not answer within 0.5 s: end it"), ("dies", "the viewer is gone")]
)
def test_a_replay_into_a_viewer_that_does_not_take_it_ends_in_one_sentence(
    viewer: str, sentence: str, record: Record, tmp_path: Path
) -> None:
    record(tmp_path / "run.mcap")
    command, paths = [sys.executable, "-c", REPLAY, tmp_path / "run.mcap", viewer], {"PYTHONPATH": ":".join(sys.path)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=paths)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert sentence in done.stderr


def test_a_viewer_follows_the_flight_to_its_end(record: Record) -> None:
    # A viewer that finds nothing to draw with may die as late as that.
    try:
        with headless((300, 200)) as (port, viewer):
            live = Live(Destination(port=port), SCALES)
            record(seconds=2.3, listeners=[live])
            live.close()
            time.sleep(1)
            (recording,) = viewer.get_state().recordings
    except LogError as error:
        pytest.skip(str(error))
    assert [(line.name, line.start, line.end) for line in recording.timelines] == [("sim_time", 0, 2_300_000_000)]


def _wait_for(port: int) -> None:
    for _ in range(200):
        try:
            socket.create_connection(("127.0.0.1", port), timeout=0.1).close()
        except OSError:
            continue
        return


def test_a_picture_that_cannot_be_drawn_is_told_and_the_flight_goes_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    live = Live(Destination(tmp_path / "run.rrd"), SCALES)
    live("/truth", 0, b"not a truth")
    live("/truth", 600_000_000, b"not a truth")
    live("/truth", 1_200_000_000, b"not a truth")
    live.close()
    assert [record.getMessage() for record in caplog.records] == ["the flight goes on without its picture"]


def test_showing_without_a_viewer_says_how_to_start_one(free_port: int) -> None:
    with pytest.raises(LogError, match=f"no viewer listens on port {free_port}: start one with"):
        show(Log({}), Destination(port=free_port), SCALES)


@pytest.mark.parametrize("is_mute", [True, False], ids=["mute", "closes"])
def test_a_port_that_another_program_uses_is_told_at_once(is_mute: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer_process, "GREETING_TIMEOUT_S", 0.2)
    connections: list[socket.socket] = []
    ended = Event()

    def serve() -> None:
        while not ended.is_set():
            with suppress(TimeoutError):
                connections.append(server.accept()[0])
                if not is_mute:
                    connections[-1].close()

    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.05)
        thread = Thread(target=serve)
        thread.start()
        port = server.getsockname()[1]
        with pytest.raises(LogError, match=f"another program than a viewer uses port {port}: .* Rerun file"):
            show(Log({}), Destination(port=port, spawn=True), SCALES)
        ended.set()
        thread.join()
    for connection in connections:
        connection.close()


def test_without_a_screen_no_viewer_is_started(free_port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(delivery, "has_screen", lambda: False)
    monkeypatch.setattr(delivery, "spawn", lambda port: pytest.fail("a viewer was started"))
    with pytest.raises(LogError, match=r"there is no screen to show a viewer on: write a Rerun file.* --web"):
        show(Log({}), Destination(port=free_port, spawn=True), SCALES)


def test_a_file_that_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot be written to"):
        Live(Destination(tmp_path), SCALES)


def test_a_full_disk_costs_no_picture_that_was_there(record: Record, tmp_path: Path) -> None:
    (tmp_path / "run.rrd").write_text("mine")
    log = record(seconds=2.0).log()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, hard))
    try:
        with pytest.raises(LogError, match="File too large"):
            show(log, Destination(tmp_path / "run.rrd"), SCALES)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [path.read_text() for path in tmp_path.iterdir()] == ["mine"]


def test_flying_does_not_import_rerun() -> None:
    code = "import sys, heli_twin.recording; sys.exit('rerun' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, env={"PYTHONPATH": ":".join(sys.path)})


def test_rerun_decodes_every_message_for_viewers(record: Record, tmp_path: Path) -> None:
    record(tmp_path / "run.mcap", seconds=0.5)
    convert = subprocess.run(
        [RERUN, "mcap", "convert", tmp_path / "run.mcap", "-o", tmp_path / "run.rrd"],
        capture_output=True,
        text=True,
        check=False,
    )
    said = convert.stdout + convert.stderr
    assert convert.returncode == 0, said
    assert "Failed" not in said
    assert "ERROR" not in said
