"""Recordings as the vendors' software exports them, of a flight that is known in closed form."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from heli_twin import HeliTwinError
from heli_twin.cli import main
from heli_twin.exchange.formats import Options
from heli_twin.exchange.import_poses import Reading, read_recording, recognised

PITCH, ROLL = 0.02, -0.07
RATE = 100.0
T = np.arange(300) / RATE
EPOCH = 1_700_000_000


def position(t: np.ndarray) -> np.ndarray:
    """(n, 3) m, north-west-up."""
    return np.column_stack([0.3 * np.cos(0.8 * t), 0.3 * np.sin(0.8 * t), 1 + 0.05 * np.sin(0.5 * t)])


def yaw(t: np.ndarray) -> np.ndarray:
    return 0.8 * t + np.pi / 2


def matrices(t: np.ndarray) -> np.ndarray:
    """(n, 3, 3) body to world: Rz(yaw) Ry(pitch) Rx(roll), written out."""
    c, s, one, zero = np.cos(yaw(t)), np.sin(yaw(t)), np.ones_like(t), np.zeros_like(t)
    turn = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]).transpose(2, 0, 1)
    cp, sp, cr, sr = np.cos(PITCH), np.sin(PITCH), np.cos(ROLL), np.sin(ROLL)
    tilt = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]) @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return turn @ tilt


def quaternions(R: np.ndarray) -> np.ndarray:
    """(n, 4) scalar first, of rotations by less than half a turn: w from the trace, the rest from the differences."""
    w = 0.5 * np.sqrt(1 + np.trace(R, axis1=1, axis2=2))
    x, y, z = (R[:, i, j] - R[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0)))
    return np.column_stack([w, x / (4 * w), y / (4 * w), z / (4 * w)])


def euler_xyz(R: np.ndarray) -> np.ndarray:
    """(n, 3) angles a b c with R = Rx(a) Ry(b) Rz(c)."""
    return np.column_stack(
        [np.arctan2(-R[:, 1, 2], R[:, 2, 2]), np.arcsin(R[:, 0, 2]), np.arctan2(-R[:, 0, 1], R[:, 0, 0])]
    )


def write(path: Path, lines: list[str], rows: np.ndarray, separator: str = ",") -> Path:
    text = [separator.join("" if np.isnan(v) else f"{v:.12g}" for v in row) for row in rows]
    path.write_text("\n".join([*lines, *text]) + "\n", encoding="utf-8")
    return path


def motive(path: Path, *, unit: str = "Millimeters", scale: float = 1e3, old: bool = False) -> Path:
    """Y up: x is our west, y up, z north, of the world and of the body."""
    P = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    q = quaternions(matrices(T))
    rows = np.column_stack(
        [np.arange(len(T)), T, q[:, 2], q[:, 3], q[:, 1], q[:, 0], scale * position(T) @ P.T, np.full(len(T), 0.1)]
    )
    other = rows[:, 2:10] * 0.5
    first = ("", "", "", "") if old else ("Type", "Name", "ID", "")
    kinds, names = ["Rigid Body"] * 8, ["wand"] * 8 + ["heli"] * 8
    parts = (["Rotation"] * 4 + ["Position"] * 3 + ["Error" if old else "Mean Marker Error"]) * 2
    header = [
        f"Format Version,1.2{1 if old else 3},Take Name,t,Rotation Type,Quaternion,Length Units,{unit},"
        "Coordinate Space,Global",
        "",
        f",{first[0]},{','.join(kinds * 2)}",
        f",{first[1]},{','.join(names)}",
        f",{first[2]},{','.join('ABCDEFGH' + 'abcdefgh')}",
        f",,{','.join(parts)}",
        "Frame,Time (Seconds)," + ",".join(["X", "Y", "Z", "W", "X", "Y", "Z", ""] * 2),
    ]
    return write(path, header, np.column_stack([rows[:, :2], other, rows[:, 2:]]))


def vicon(path: Path) -> Path:
    rows = np.column_stack([np.arange(1, len(T) + 1), 0 * T, euler_xyz(matrices(T)), 1e3 * position(T)])
    header = ["Objects", "100", ",,heli:heli,,,,,", "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ", ",,rad,rad,rad,mm,mm,mm"]
    return write(path, header, rows)


def nexus_in_degrees(path: Path) -> Path:
    rows = np.column_stack([np.arange(1, len(T) + 1), 0 * T, np.degrees(euler_xyz(matrices(T))), 1e3 * position(T)])
    header = ["Segments", "100", ",,heli:body,,,,,", "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ", ",,deg,deg,deg,mm,mm,mm"]
    return write(path, header, rows)


def qualisys(path: Path) -> Path:
    """The matrix column by column; a lost body has zeros."""
    columns = matrices(T).transpose(0, 2, 1).reshape(-1, 9)
    rows = np.column_stack(
        [np.arange(1, len(T) + 1), T, 1e3 * position(T), np.zeros((len(T), 3)), 0 * T + 1.2, columns]
    )
    rows[50:60, 2:] = 0
    names = "\t".join(f"Rot[{i}]" for i in range(9))
    header = [
        "NO_OF_FRAMES\t300",
        "NO_OF_CAMERAS\t8",
        "NO_OF_BODIES\t1",
        "FREQUENCY\t100",
        "DESCRIPTION\t--",
        "TIME_STAMP\t2024-05-02, 10:11:12\t1.0",
        "DATA_INCLUDED\t6D",
        "BODY_NAMES\theli",
        f"Frame\tTime\theli X\tY\tZ\tRoll\tPitch\tYaw\tResidual\t{names}",
    ]
    return write(path, header, rows, "\t")


def tum(path: Path) -> Path:
    q = quaternions(matrices(T))
    return write(path, ["# ground truth"], np.column_stack([T, position(T), q[:, 1:], q[:, 0]]), " ")


def euroc(path: Path) -> Path:
    header = ["#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"]
    return write(path, header, np.column_stack([np.round(1e9 * T), position(T), quaternions(matrices(T))]))


def ros2(path: Path, kind: str = "geometry_msgs/msg/PoseStamped") -> Path:
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    of = types.types
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start("ros2")
        schema = writer.register_schema(kind, "ros2msg", b"")
        channel = writer.register_channel("/heli/pose", "cdr", schema)
        for t, p, (w, x, y, z) in zip(T, position(T), quaternions(matrices(T)), strict=True):
            nanoseconds = round(1e9 * t)
            stamp = of["builtin_interfaces/msg/Time"](EPOCH + nanoseconds // 10**9, nanoseconds % 10**9)
            header = of["std_msgs/msg/Header"](stamp, "world")
            turn = of["geometry_msgs/msg/Quaternion"](x, y, z, w)
            pose = of["geometry_msgs/msg/Pose"](of["geometry_msgs/msg/Point"](*p), turn)
            moved = of["geometry_msgs/msg/Transform"](of["geometry_msgs/msg/Vector3"](*p), turn)
            transform = of["geometry_msgs/msg/TransformStamped"](header, "heli", moved)
            match kind.rpartition("/")[2]:
                case "PoseStamped":
                    message = of[kind](header, pose)
                case "TransformStamped":
                    message = transform
                case "TFMessage":
                    message = of[kind]([transform])
                case _:
                    still = of["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
                    twist = of["geometry_msgs/msg/Twist"](still, still)
                    message = of[kind](
                        header,
                        "heli",
                        of["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
                        of["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
                    )
            data = types.serialize_cdr(message, kind)
            at = EPOCH * 10**9 + nanoseconds
            writer.add_message(channel, at + 8_000_000, bytes(data), at)
        writer.finish()
    return path


EXPORTS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "motive": (motive, "OptiTrack Motive CSV"),
    "motive 1.x in metres": (lambda p: motive(p, unit="Meters", scale=1.0, old=True), "OptiTrack Motive CSV"),
    "vicon tracker": (vicon, "Vicon CSV"),
    "vicon nexus": (nexus_in_degrees, "Vicon CSV"),
    "qualisys": (qualisys, "Qualisys 6D TSV"),
    "tum": (tum, "TUM trajectory"),
    "euroc": (euroc, "EuRoC ground truth"),
    "ros pose": (ros2, "ROS 2 bag (MCAP)"),
    "ros transform": (lambda p: ros2(p, "geometry_msgs/msg/TransformStamped"), "ROS 2 bag (MCAP)"),
    "ros tf": (lambda p: ros2(p, "tf2_msgs/msg/TFMessage"), "ROS 2 bag (MCAP)"),
    "ros odometry": (lambda p: ros2(p, "nav_msgs/msg/Odometry"), "ROS 2 bag (MCAP)"),
}


@pytest.mark.parametrize("export", EXPORTS)
def test_an_export_is_recognised_and_read_as_it_was_flown(tmp_path: Path, export: str) -> None:
    make, title = EXPORTS[export]
    path = make(tmp_path / "recording")
    body = "heli" if "motive" in export else ""
    assert title == recognised(path).TITLE
    _, recording = read_recording(path, Reading(Options(body=body)))
    assert recording.rate == pytest.approx(RATE, rel=1e-4)
    assert len(recording.time) == (290 if export == "qualisys" else 300)
    # The text of these files has twelve digits; a clock that counts from 1970 resolves 0.24 us.
    np.testing.assert_allclose(recording.position, position(recording.time), atol=1e-6)
    expected = matrices(recording.time)
    w, x, y, z = recording.quat_wxyz.T
    nose = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    up = np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    np.testing.assert_allclose(nose, expected[:, :, 0], atol=1e-6)
    np.testing.assert_allclose(up, expected[:, :, 2], atol=1e-6)


def test_a_ros_bag_knows_when_a_pose_arrived(tmp_path: Path) -> None:
    _, recording = read_recording(ros2(tmp_path / "bag.mcap"), Reading())
    np.testing.assert_allclose(recording.arrival - recording.time, 0.008, atol=1e-6)


def test_one_of_several_bodies_has_to_be_named(tmp_path: Path) -> None:
    path = motive(tmp_path / "take.csv")
    with pytest.raises(HeliTwinError, match="has 2 bodies: choose one with --body, of wand, heli"):
        read_recording(path, Reading())
    with pytest.raises(HeliTwinError, match="has no body 'hali': did you mean 'heli'"):
        read_recording(path, Reading(Options(body="hali")))


def test_vicon_s_three_angles_may_be_a_rotation_vector(tmp_path: Path) -> None:
    R = matrices(T)
    q = quaternions(R)
    angle = 2 * np.arccos(q[:, 0])
    vector = q[:, 1:] * (angle / np.sin(angle / 2))[:, None]
    header = ["Objects", "100", ",,heli:heli,,,,,", "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ", ",,rad,rad,rad,mm,mm,mm"]
    path = write(tmp_path / "v.csv", header, np.column_stack([1 + np.arange(len(T)), 0 * T, vector, 1e3 * position(T)]))
    take, recording = read_recording(path, Reading(Options(rotation="vector")))
    np.testing.assert_allclose(np.abs((recording.quat_wxyz * q).sum(axis=1)), 1.0, atol=1e-9)
    assert not take.notes
    assert "--rotation vector" in read_recording(vicon(tmp_path / "e.csv"), Reading())[0].notes[0]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda text: text.replace("Frame,Time", "Frames,Time"), "no line that begins with Frame"),
        (lambda text: text.replace("Millimeters", "Parsecs"), "Length Units is 'parsecs'"),
        (lambda text: text.replace("Rigid Body", "Marker"), "has no rigid body"),
        (lambda text: text[: text.index("\n0,")] + "\n", "has no rows of numbers"),
    ],
)
def test_a_damaged_take_is_told_in_one_sentence(tmp_path: Path, damage: Callable[[str], str], message: str) -> None:
    path = motive(tmp_path / "take.csv")
    path.write_text(damage(path.read_text()))
    with pytest.raises(HeliTwinError, match=message):
        read_recording(path, Reading(Options(body="heli")))


def test_bytes_of_no_format_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "x.bin").write_bytes(bytes(range(256)) * 50)
    assert main(["import", str(tmp_path / "x.bin")]) == 2
    assert "is no recording that can be read" in capsys.readouterr().err


def test_list_shows_what_is_recognised_and_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = vicon(tmp_path / "take.csv")
    assert main(["import", str(path), "--list"]) == 0
    out = capsys.readouterr().out
    assert "Vicon CSV" in out
    assert "heli:heli" in out
    assert "300 poses of heli:heli at 100.0 Hz" in out
    assert [*tmp_path.iterdir()] == [path]


@pytest.mark.parametrize("unit", ["mm", "cm", "in", "ft"])
@pytest.mark.parametrize("export", ["tum", "motive", "vicon tracker", "qualisys", "euroc"])
def test_the_unit_that_the_user_says_is_that_of_the_file(tmp_path: Path, export: str, unit: str) -> None:
    """Also where the header or the format says another: whoever made the file may have scaled it."""
    path, said = EXPORTS[export][0](tmp_path / "recording"), {"tum": 1.0, "euroc": 1.0}.get(export, 1e-3)
    body = Options(body="heli" if export == "motive" else "")
    _, as_it_says = read_recording(path, Reading(body))
    _, recording = read_recording(path, Reading(body, unit=unit, is_checked=False))
    metres = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254, "ft": 0.3048}[unit]
    np.testing.assert_allclose(recording.position, as_it_says.position / said * metres, rtol=1e-12)


def test_a_factor_in_the_map_and_units_contradict_each_other(tmp_path: Path) -> None:
    path = write(tmp_path / "t.csv", ["time,px,py,pz,yaw"], np.column_stack([T, 1e3 * position(T), yaw(T)]))
    options = Options(columns="x=px*0.001,y=py*0.001,z=pz*0.001")
    np.testing.assert_allclose(read_recording(path, Reading(options))[1].position, position(T), atol=1e-9)
    with pytest.raises(HeliTwinError, match="--units mm: the map has factors of lengths already"):
        read_recording(path, Reading(options, unit="mm"))


def test_iso_dates_are_times(tmp_path: Path) -> None:
    begin = np.datetime64("2024-05-02T10:11:12.000")
    stamps = [str(begin + np.timedelta64(round(1000 * t), "ms")) for t in T]
    rows = np.column_stack([position(T), yaw(T)]).tolist()
    lines = [f"{stamp},{','.join(f'{v:.9f}' for v in row)}" for stamp, row in zip(stamps, rows, strict=True)]
    (tmp_path / "t.csv").write_text("\n".join(["time,x,y,z,yaw", *lines]))
    _, recording = read_recording(tmp_path / "t.csv", Reading())
    np.testing.assert_allclose(recording.time, T, atol=1e-6)
    np.testing.assert_allclose(recording.position, position(T), atol=1e-6)


def test_the_answer_names_the_axes_that_the_user_gave(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    P = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    q = quaternions(matrices(T))
    rows = np.column_stack([T, 1e3 * position(T) @ P.T, q[:, 2], q[:, 3], q[:, 1], q[:, 0]])
    path = write(tmp_path / "t.csv", ["time,x,y,z,qx,qy,qz,qw"], rows)
    assert main(["import", str(path), "--units", "mm"]) == 2
    assert "say --frame yup" in capsys.readouterr().err
    assert main(["import", str(path), "--units", "mm", "--frame", "yup", "--list"]) == 0
    assert "axes in the file: x left, y up, z forward" in capsys.readouterr().out
