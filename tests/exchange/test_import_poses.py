"""A motion-capture recording becomes a log that the other tools take."""

from pathlib import Path

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform

from heli_twin import HeliTwinError, fly, load, read_log
from heli_twin.cli import main
from heli_twin.exchange.formats import Options
from heli_twin.exchange.formats.table import Source, parse_map
from heli_twin.exchange.import_poses import Reading, import_poses
from heli_twin.identification.data import stretches
from heli_twin.identification.identify import identify
from heli_twin.metrics.tracking import metrics
from heli_twin.reanalysis.reestimate import reestimate, same_bits
from heli_twin.reanalysis.resolve import resolve
from heli_twin.recording import Log

HEAD = "time,x,y,z,yaw"
ROWS = [f"{0.01 * i:.3f},{0.1 * i:.4f},0,1,0" for i in range(100)]
"""One second northwards at 10 m/s, in rows of 10 ms."""


def _file(folder: Path, *lines: str) -> Path:
    path = folder / "poses.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _imported(folder: Path, *lines: str, columns: str = "", overrides: tuple[str, ...] = ()) -> Log:
    out = folder / "run.mcap"
    import_poses(_file(folder, *lines), out, Reading(Options(columns=columns)), overrides)
    return read_log(out)


def test_poses_and_their_times_survive(tmp_path: Path) -> None:
    log = _imported(tmp_path, HEAD, *ROWS, overrides=("mocap.latency=0.008",))
    np.testing.assert_array_equal(log.pose.stamp, 10_000_000 * np.arange(100))
    np.testing.assert_array_equal(log.pose.time, log.pose.stamp + 8_000_000)
    # Text has four decimals.
    np.testing.assert_allclose(log.pose.position[:, 0], 0.1 * np.arange(100), atol=1e-12)
    assert log.outcome == "imported"
    assert not len(log.truth.time)


def test_names_units_and_a_late_clock_are_mapped(tmp_path: Path) -> None:
    rows = [f"{1.7e9 + 0.01 * i:.4f};{100 * i};5;1000;90" for i in range(50)]
    columns = "time=t,x=px*0.001,y=py*0.001,z=pz*0.001,yaw=heading*0.017453292519943295"
    log = _imported(tmp_path, "t;px;py;pz;heading", *rows, columns=columns)
    # A clock that counts from 1970 resolves 0.24 us.
    np.testing.assert_allclose(log.pose.stamp, 1e7 * np.arange(50), atol=500)
    np.testing.assert_allclose(log.pose.position[10], [1.0, 0.005, 1.0], rtol=1e-12)
    np.testing.assert_allclose(log.pose.quat_wxyz[0], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)], rtol=1e-12)


def test_quaternions_are_normalised(tmp_path: Path) -> None:
    log = _imported(tmp_path, "time,x,y,z,qw,qx,qy,qz", "0,0,0,1,1.01,0,0,0", "0.01,0,0,1,0.99,0,0,0")
    np.testing.assert_array_equal(log.pose.quat_wxyz, [[1, 0, 0, 0], [1, 0, 0, 0]])


def test_an_empty_or_nan_pose_is_a_lost_frame(tmp_path: Path) -> None:
    rows = [*ROWS[:3], "0.03,,,,", "0.04,nan,nan,nan,nan", *ROWS[5:]]
    recording = import_poses(_file(tmp_path, HEAD, *rows), tmp_path / "run.mcap").recording
    assert recording.lost == 2
    assert len(recording.time) == 98


def test_commands_reach_the_estimator_and_the_log(tmp_path: Path) -> None:
    rows = [f"{row},0.1,0,0.545,0" for row in ROWS[:-1]] + [f"{ROWS[-1]},,,,"]
    log = _imported(tmp_path, f"{HEAD},ux,uy,uz,uyaw", *rows)
    assert len(log.sent.time) == 99
    np.testing.assert_array_equal(log.sent.u[0], [0.1, 0, 0.545, 0])


def test_an_estimator_run_again_on_an_import_says_the_same(tmp_path: Path) -> None:
    rows = [f"{row},0.1,0,0.545,0" for row in ROWS]
    log = _imported(tmp_path, f"{HEAD},ux,uy,uz,uyaw", *rows)
    assert len(log.estimate.time) > 45
    assert same_bits(reestimate(log).estimates, log.estimate)


def test_a_controller_can_shadow_an_import(tmp_path: Path) -> None:
    slow = [f"{0.01 * i:.3f},{0.001 * i:.4f},0,1,0" for i in range(100)]
    log = _imported(tmp_path, HEAD, *slow)
    assert len(resolve(log, ["trajectory=hover"]).commands) == len(log.estimate.time)


def test_a_controller_cannot_be_judged_against_a_flight_that_nobody_named(tmp_path: Path) -> None:
    with pytest.raises(HeliTwinError, match="no reference: say what was to be flown, such as trajectory="):
        resolve(_imported(tmp_path, HEAD, *ROWS), ["controller.horizon=12"])


def test_a_trajectory_that_is_given_is_the_reference(tmp_path: Path) -> None:
    log = _imported(tmp_path, HEAD, *ROWS, overrides=("trajectory=hover", "trajectory.height=1.5"))
    np.testing.assert_array_equal(log.reference.x[:, 2], 1.5)
    assert len(log.reference.time) > 45


def test_a_real_flight_moves_in_viewers_that_know_nothing_of_us(tmp_path: Path) -> None:
    tf = _imported(tmp_path, HEAD, *ROWS).messages["/tf"]
    # Every 40 ms of a second.
    assert len(tf.times) == 25
    last = FrameTransform.FromString(bytes(tf.data[-1]))
    np.testing.assert_allclose(last.translation.x, 9.6, atol=1e-12)


def test_identification_sees_an_import_as_it_sees_the_flight(tmp_path: Path) -> None:
    """In mm and percent, with a clock of its own, poses and commands in rows of their own."""
    flight = fly(load("ideal", ["trajectory=doublets", "duration=12"]), log_dir=None).log
    rows: dict[int, list[object]] = {}
    for t, pose in zip(flight.pose.stamp, np.hstack([1e3 * flight.pose.position, flight.pose.quat_wxyz]), strict=True):
        rows[int(t)] = [*pose.tolist(), "", "", "", ""]
    for t, u in zip(flight.sent.time, 100 * flight.sent.u, strict=True):
        rows[int(t)] = [*rows.get(int(t), [""] * 7)[:7], *u.tolist()]
    lines = [";".join(map(str, [5.0 + 1e-9 * t, *rows[t]])) for t in sorted(rows)]
    head = "Time (s);TX;TY;TZ;RW;RX;RY;RZ;pitch (%);roll (%);thrust (%);turn (%)"
    columns = (
        "time=Time (s),x=TX*1e-3,y=TY*1e-3,z=TZ*1e-3,qw=RW,qx=RX,qy=RY,qz=RZ,"
        "ux=pitch (%)*0.01,uy=roll (%)*0.01,uz=thrust (%)*0.01,uyaw=turn (%)*0.01"
    )
    (ours,), (theirs,) = stretches(_imported(tmp_path, head, *lines, columns=columns), ""), stretches(flight, "")
    for axis, equation in theirs.axes.items():
        # Differentiating twice magnifies the rounding of a float's last digit 1e4 times.
        np.testing.assert_allclose(ours.axes[axis].accel, equation.accel, atol=1e-9)
        np.testing.assert_allclose(ours.axes[axis].input(0.1, 0.02), equation.input(0.1, 0.02), atol=1e-9)


def test_poses_in_other_units_are_noticed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    degrees = [f"{0.01 * i:.3f},0,0,1,{20.0 * 0.01 * i}" for i in range(100)]
    assert main(["import", str(_file(tmp_path, HEAD, *degrees))]) == 0
    assert "the estimator refused" in capsys.readouterr().err


@pytest.mark.parametrize("mistake", [["--out", "run.csv"], ["duration=5"], ["trajectory=cirle"]])
def test_a_mistake_in_the_command_leaves_nothing(
    tmp_path: Path, mistake: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    path = _file(tmp_path, HEAD, *ROWS)
    assert main(["import", str(path), *mistake]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert [*tmp_path.iterdir()] == [path]


def test_metrics_of_an_import_are_unknown_and_not_wrong(tmp_path: Path) -> None:
    assert metrics(_imported(tmp_path, HEAD, *ROWS))["rmse"]["x"] is None


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("Time,x,y,z,yaw", "0,0,0,1,0"), r"its columns are Time, x, y, z, yaw; say which it is with --map time=Time"),
        (("time,x,x,y,z,yaw", "0,0,0,0,1,0"), r"names 'x' twice"),
        ((HEAD, "0,1_0,0,1,0"), r"line 2, column 'x': '1_0' is not a number$"),
        ((HEAD.replace(",", ";"), "0,5;0;0;1;0"), r"'0,5' is not a number: write a decimal point"),
        ((HEAD, "0,0,0,1,0", "300,0,0,1,0"), r"rows are 300 apart .* in s, ms, us, ns"),
        ((HEAD, "0,0,0,1,0", "0.00001,0,0,1,0"), r"rows are 1e-05 apart"),
        ((HEAD, ROWS[0], "0.01,one,0,1,0"), r"line 3, column 'x': 'one' is not a number"),
        ((HEAD, ROWS[0], "0.01,inf,0,1,0"), r"line 3, column 'x': 'inf' is not a finite number"),
        ((HEAD, ROWS[1], ROWS[0]), r"1 of 2 rows come before the row above them"),
        ((HEAD, "0,0,0,1000,0"), r"a position is 1000 m from the origin, 100 m at most"),
        ((HEAD, ",0,0,1,0"), r"no row has a time"),
        ((HEAD, ROWS[0], ROWS[1], ROWS[2], "99999,0,0,1,0"), r"the last row is 99999 s after the first"),
        (("time,x,y,z", "0,0,0,1"), r"line 1 names no column for qw"),
        (("t,x,y,z,yaw", "0,0,0,1,0"), r"line 1 names no column for time"),
        (("time,x,y,z,qw,qx,qy,qz", "0,0,0,1,2,0,0,0"), r"line 2: the quaternion has length 2"),
        ((f"{HEAD},ux,uy,uz,uyaw", "0,0,0,1,0,0,0,2,0"), r"line 2: uz = 2 is beyond full stick"),
        ((f"{HEAD},arrival", "1,0,0,1,0,0.5"), r"line 2: arrival -0\.5 s does not follow the picture, 0 s"),
        ((HEAD,), r"has no rows of numbers"),
        (("",), r"line 1 names no column for time"),
        ((HEAD, '0,"0,0,1,0'), r"is not a table in UTF-8"),
    ],
)
def test_a_bad_file_is_refused_by_line_and_column(tmp_path: Path, lines: tuple[str, ...], message: str) -> None:
    with pytest.raises(HeliTwinError, match=message):
        _imported(tmp_path, *lines)
    assert not list(tmp_path.glob("*.mcap*"))


@pytest.mark.parametrize("text", ["speed=v", "x", "x=a*b", "x=a*inf", "x=a*0", "x=a,x=b"])
def test_a_bad_map_is_refused(text: str) -> None:
    with pytest.raises(HeliTwinError, match=text.split("=")[0]):
        parse_map(text)


def test_a_map_names_columns_and_factors() -> None:
    assert parse_map("time=t, x=p*x*2") == {"time": Source("t"), "x": Source("p*x", 2.0)}


def test_a_mapped_column_has_to_be_there(tmp_path: Path) -> None:
    with pytest.raises(HeliTwinError, match=r"line 1 names no column 'px'"):
        _imported(tmp_path, HEAD, *ROWS, columns="x=px")


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "poses.csv").write_bytes(b"\xff\xfe\x00" * 100)
    with pytest.raises(HeliTwinError, match="is no recording that can be read"):
        import_poses(tmp_path / "poses.csv", tmp_path / "run.mcap")


def test_the_command_imports(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = _file(tmp_path, HEAD, *ROWS)
    assert main(["import", str(path)]) == 0
    assert "100 poses" in capsys.readouterr().out
    assert main(["reestimate", str(tmp_path / "poses.mcap")]) == 0
    assert "no /truth" in capsys.readouterr().out
    assert main(["refly", str(tmp_path / "poses.mcap")]) == 2
    assert main(["import", str(path)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_some_of_the_inputs_are_enough(tmp_path: Path) -> None:
    """What is not there is not a number in the log; the estimator takes it to be at hover."""
    log = _imported(tmp_path, f"{HEAD},ux,uy", *(f"{row},0.1,0" for row in ROWS))
    np.testing.assert_array_equal(log.sent.u[:, :2], np.tile([0.1, 0.0], (100, 1)))
    assert np.isnan(log.sent.u[:, 2:]).all()
    assert np.isfinite(log.estimate.x).all()


def test_x_and_y_are_identified_without_thrust_commands(tmp_path: Path) -> None:
    """Two of four inputs are enough for two of four axes: the gains within 2 %, for the thrust hardly varies."""
    flight = fly(load("ideal", ["trajectory=doublets", "duration=60"]), log_dir=None).log
    u = flight.sent.u[np.searchsorted(flight.sent.time, flight.pose.stamp, side="right") - 1]
    rows = np.column_stack([1e-9 * flight.pose.stamp, flight.pose.position, flight.pose.quat_wxyz, u[:, :2]])
    lines = [",".join(f"{value:.12g}" for value in row) for row in rows]
    log = _imported(tmp_path, "time,x,y,z,qw,qx,qy,qz,ux,uy", *lines)
    parameters = identify([("import", log)]).parameters
    assert sorted(parameters) == ["b_x", "b_y", "k_x", "k_y"]
    assert parameters["b_x"].value == pytest.approx(2.0, rel=0.02)
    assert parameters["b_y"].value == pytest.approx(2.1, rel=0.02)
