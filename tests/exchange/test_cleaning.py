"""Blemishes of recordings are normal: found, counted, left out; only disorder is refused."""

from pathlib import Path

import numpy as np
import pytest

from heli_twin import HeliTwinError, read_log
from heli_twin.exchange.formats import Options
from heli_twin.exchange.import_poses import AS_EXPORTED, Reading, import_poses, read_recording

T = np.arange(400) / 100.0


def rows() -> np.ndarray:
    """A slow circle with the nose along it: time x y z yaw."""
    return np.column_stack([T, 0.3 * np.cos(T), 0.3 * np.sin(T), 1 + 0 * T, T + np.pi / 2])


def write(folder: Path, table: np.ndarray, head: str = "time,x,y,z,yaw") -> Path:
    text = [",".join("" if np.isnan(v) else f"{v:.9g}" for v in row) for row in table]
    path = folder / "r.csv"
    path.write_text("\n".join([head, *text]) + "\n")
    return path


def blemishes(path: Path, reading: Reading = AS_EXPORTED) -> dict[str, int]:
    return {b.name: b.rows for b in read_recording(path, reading)[1].blemishes}


def test_a_clean_recording_has_none(tmp_path: Path) -> None:
    assert blemishes(write(tmp_path, rows())) == {}


def test_rows_of_zeros_are_lost_frames(tmp_path: Path) -> None:
    table = rows()
    table[100:110, 1:] = 0
    path = write(tmp_path, table)
    assert blemishes(path) == {"rows_of_zeros": 10, "gaps": 1}
    assert read_recording(path, Reading())[1].lost == 10


def test_a_half_turn_and_back_is_left_out(tmp_path: Path) -> None:
    table = rows()
    table[200:220, 4] += np.pi
    path = write(tmp_path, table)
    assert blemishes(path) == {"flips": 20, "gaps": 1}
    _, recording = read_recording(path, Reading())
    assert not np.isin(np.round(recording.time, 6), np.round(T[200:220], 6)).any()


def test_a_helicopter_that_turns_for_good_is_believed(tmp_path: Path) -> None:
    table = rows()
    table[200:, 4] += np.pi
    assert blemishes(write(tmp_path, table)) == {}


def test_repeated_and_late_rows(tmp_path: Path) -> None:
    table = np.vstack([rows()[:50], rows()[49:50], rows()[50:]])
    table[[300, 301]] = table[[301, 300]]
    path = write(tmp_path, table)
    assert blemishes(path) == {"repeated_times": 1, "late_rows": 1}
    _, recording = read_recording(path, Reading())
    np.testing.assert_allclose(recording.time, T, atol=1e-12)


def test_blemishes_are_events_of_the_log(tmp_path: Path) -> None:
    table = rows()
    table[100:110, 1:] = 0
    import_poses(write(tmp_path, table), tmp_path / "r.mcap")
    events = {event.name: event for event in read_log(tmp_path / "r.mcap").events}
    assert events["rows_of_zeros"].time == 1_000_000_000
    assert events["rows_of_zeros"].text.startswith("10 rows of zeros")


@pytest.mark.parametrize(
    ("factor", "start"),
    [(1.0, 0.0), (1e3, 0.0), (1e6, 5e6), (1e9, 0.0), (1.0, 1.7e9)],
    ids=["s", "ms", "us", "ns", "epoch"],
)
def test_the_unit_of_time_is_found_from_the_data(tmp_path: Path, factor: float, start: float) -> None:
    table = rows()
    text = [",".join([f"{start + factor * row[0]:.4f}", *map(repr, row[1:])]) for row in table.tolist()]
    path = tmp_path / "r.csv"
    path.write_text("time,x,y,z,yaw\n" + "\n".join(text))
    _, recording = read_recording(path, Reading())
    assert recording.rate == pytest.approx(100.0, rel=1e-4)
    np.testing.assert_allclose(recording.time, T, atol=1e-6)


def test_dates_are_times(tmp_path: Path) -> None:
    text = [f"2024-05-02T10:11:{12 + t:09.6f}+00:00,{x},{y},{z},{yaw}" for t, x, y, z, yaw in rows()]
    (tmp_path / "r.csv").write_text("time,x,y,z,yaw\n" + "\n".join(text))
    assert read_recording(tmp_path / "r.csv", Reading())[1].rate == pytest.approx(100.0, rel=1e-3)


def test_frames_need_their_rate(tmp_path: Path) -> None:
    table = rows()
    table[:, 0] = np.arange(len(T))
    path = write(tmp_path, table)
    with pytest.raises(HeliTwinError, match="counts frames: say their rate in Hz with --rate"):
        read_recording(path, Reading())
    assert read_recording(path, Reading(rate=100.0))[1].rate == pytest.approx(100.0)


def test_columns_by_number_blanks_comments_units_and_constants(tmp_path: Path) -> None:
    text = [
        "# made by hand",
        "t px py pz",
        "s mm mm mm",
        *(f"{t} {1e3 * x} {1e3 * y} 1000" for t, x, y, _, _ in rows()),
    ]
    (tmp_path / "r.txt").write_text("\n".join(text))
    options = Options(columns="time=1,x=px,y=3,z=4,yaw=0.5,ux=0")
    take, recording = read_recording(tmp_path / "r.txt", Reading(options, unit="mm"))
    np.testing.assert_allclose(recording.position, rows()[:, 1:4], atol=1e-9)
    np.testing.assert_allclose(recording.quat_wxyz[:, 0], np.cos(0.25), rtol=1e-12)
    assert take.u is not None
    np.testing.assert_array_equal(take.u[:, 0], 0.0)
    assert np.isnan(take.u[:, 1:]).all()


def test_rows_in_no_order_are_refused(tmp_path: Path) -> None:
    table = rows()
    np.random.default_rng(0).shuffle(table)
    with pytest.raises(HeliTwinError, match="sort the rows by time"):
        read_recording(write(tmp_path, table), Reading())


def y_up() -> np.ndarray:
    """The circle as Motive has it, with its quaternions: time x y z qw qx qy qz."""
    _, x, y, z, yaw = rows().T
    return np.column_stack([T, y, z, x, np.cos(yaw / 2), 0 * T, np.sin(yaw / 2), 0 * T])


HEAD = "time,x,y,z,qw,qx,qy,qz"


def test_the_wrong_axes_are_refused_with_the_flag_that_mends_it(tmp_path: Path) -> None:
    path = write(tmp_path, y_up(), HEAD)
    with pytest.raises(HeliTwinError, match=r"mean tilt is .* say --frame yup"):
        read_recording(path, Reading())
    _, recording = read_recording(path, Reading(frame="yup"))
    np.testing.assert_allclose(recording.position, rows()[:, 1:4], atol=1e-8)
    assert len(read_recording(path, Reading(is_checked=False))[1].time) == len(T)


@pytest.mark.parametrize("frame", ["ned", "enu"])
def test_other_axes_become_ours(tmp_path: Path, frame: str) -> None:
    _, x, y, z, yaw = rows().T
    zero = 0 * T
    if frame == "ned":
        turn = -yaw
        table = np.column_stack([T, x, -y, -z, np.cos(turn / 2), zero, zero, np.sin(turn / 2)])
    else:
        turn = yaw + np.pi / 2
        table = np.column_stack([T, -y, x, z, np.cos(turn / 2), zero, zero, np.sin(turn / 2)])
    _, recording = read_recording(write(tmp_path, table, HEAD), Reading(frame=frame))
    np.testing.assert_allclose(recording.position, rows()[:, 1:4], atol=1e-8)
    w, _, _, qz = recording.quat_wxyz.T
    np.testing.assert_allclose(np.exp(2j * np.arctan2(qz, w)), np.exp(1j * yaw), atol=1e-8)


def test_millimetres_are_recognised_as_too_far(tmp_path: Path) -> None:
    table = rows()
    table[:, 1:4] *= 1e3
    with pytest.raises(HeliTwinError, match="say --units mm"):
        read_recording(write(tmp_path, table), Reading())
    assert read_recording(write(tmp_path, table), Reading(unit="mm"))[1].position.max() < 2


def test_a_mirrored_axis_is_noticed(tmp_path: Path) -> None:
    """Leaning to the middle of the circle while accelerating away from it along one axis."""
    lean = 0.3 * 4.0 / 9.81
    angle = 2.0 * T
    towards = np.column_stack([-np.cos(angle), -np.sin(angle)]) * np.sin(lean / 2)
    q = np.column_stack([np.full_like(T, np.cos(lean / 2)), -towards[:, 1], towards[:, 0], 0 * T])
    table = np.column_stack([T, 0.3 * np.cos(angle), 0.3 * np.sin(angle), 1 + 0 * T, q])
    read_recording(write(tmp_path, table, HEAD), Reading())
    table[:, 2] *= -1
    with pytest.raises(HeliTwinError, match="an axis is mirrored"):
        read_recording(write(tmp_path, table, HEAD), Reading())
