import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from controllers.model import Model, advance
from controllers.trajectories.circle import Circle
from controllers.trajectories.doublets import Doublets
from controllers.trajectories.hover import Hover
from heli_twin.cli import main
from heli_twin.experiment.text import load
from heli_twin.identification.data import GRID_S, MAX_GAP_S, WINDOW_S, angles_of, clean_poses, stretches
from heli_twin.identification.figure import residual_figures
from heli_twin.identification.fit import MEMORY_S, IdentificationError, half_widths
from heli_twin.identification.flights import HEIGHT_AND_YAW_FLIGHTS, PLANE_FLIGHTS, experiments, fly_them
from heli_twin.identification.identify import identify
from heli_twin.mission import fly
from heli_twin.reporting.svg import write_svg

MODEL = Model()
OTHER = Model(b_x=3.1, k_x=-0.2, b_y=1.4, k_y=-0.9, b_z=14.0, b_yaw=60.0, k_yaw=-2.0)
NAMES = ("b_x", "k_x", "b_y", "k_y", "b_z", "b_yaw", "k_yaw")


def flown(*axes, model=MODEL, seconds=30.0, late=0, lag=0.0, heading=0.0, turn=0.0, push=(0.1, -0.05, 0.2, 0.5)):
    """An open-loop flight of the model itself as a log: poses every 10 ms, commands every 20 ms, nothing else.

    The inputs of `axes` are pulsed about hover; `late` is in samples of 10 ms, `lag` in s, `turn` a constant
    yaw input.
    """
    t = 0.01 * np.arange(round(seconds / 0.01))
    u = np.array(model.u_hover) + np.zeros((len(t), 1)) + [0.0, 0.0, 0.0, turn]
    for axis, period, size in zip(range(4), (4.0, 4.6, 2.0, 1.2), (0.5, 0.5, 0.05, 0.1), strict=True):
        pulses = np.sign(np.sin(2 * np.pi * t / period) * np.cos(2 * np.pi * t / period / 3.7))
        u[:, axis] += size * pulses if axis in axes else 0.0
    u[1::2] = u[0::2][: len(u[1::2])]
    acting = u.copy()
    for i in range(1, len(t) if lag else 0):
        acting[i] = u[i - 1] + (acting[i - 1] - u[i - 1]) * np.exp(-0.01 / lag)
    # Far from the floor: nothing holds it up here.
    x, poses = (0.0, 0.0, 1e4, heading, 0.0, 0.0, 0.0, 0.0), []
    for i in range(len(t)):
        poses.append(x[:4])
        x = advance(model, x, tuple(acting[max(i - late, 0)].tolist()), 0.01, push)
    return as_log(t, np.array(poses), u)


def pair(**how):
    """One flight in the plane and one in height and heading."""
    return flown(0, 1, **how), flown(2, 3, **how | {"turn": 0.0})


def as_log(t, poses, u):
    stamp = np.round(t * 1e9).astype(np.int64)
    yaw = poses[:, 3]
    quat = np.column_stack([np.cos(yaw / 2), np.zeros((len(t), 2)), np.sin(yaw / 2)])
    pose = SimpleNamespace(stamp=stamp, time=stamp, position=poses[:, :3], quat_wxyz=quat)
    return SimpleNamespace(pose=pose, sent=SimpleNamespace(time=stamp[::2], stamp=stamp[::2], u=u[::2]))


def found(*logs):
    return identify((f"flight {i}", log) for i, log in enumerate(logs))


def misses(result, model=MODEL):
    """Relative errors of the parameters."""
    return {name: p.value / getattr(model, name) - 1.0 for name, p in result.parameters.items()}


@pytest.mark.parametrize("lean", [[np.sin(0.2), 0.0], [0.0, np.sin(0.2)]], ids=["roll", "pitch"])
@pytest.mark.parametrize("length", [2.0, 0.12])
def test_a_quaternion_of_any_length_is_the_same_attitude(lean, length):
    log = flown(2, seconds=8.0)
    log.pose.quat_wxyz[:] = [np.cos(0.2), *lean, 0.0]
    other = SimpleNamespace(
        pose=SimpleNamespace(**vars(log.pose) | {"quat_wxyz": length * log.pose.quat_wxyz}), sent=log.sent
    )
    (one,), (scaled,) = stretches(log, "one"), stretches(other, "other")
    np.testing.assert_allclose(scaled.axes["z"].input(0.0, 0.0), one.axes["z"].input(0.0, 0.0), rtol=1e-12)
    # Leaning by 0.4 rad, cos(0.4) of the thrust lifts.
    level = next(stretches(flown(2, seconds=8.0), "level")).axes["z"].input(0.0, 0.0)
    np.testing.assert_allclose(one.axes["z"].input(0.0, 0.0), np.cos(0.4) * level, rtol=1e-9)


@given(st.floats(-3.0, 3.0), st.floats(-1.4, 1.4), st.floats(-3.0, 3.0))
def test_angles_of_an_attitude_are_yaw_pitch_and_roll(yaw, pitch, roll):
    quat = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat(scalar_first=True)
    np.testing.assert_allclose(angles_of(quat[None])[0], [yaw, pitch, roll], atol=1e-7)


@pytest.mark.parametrize("axis", ["x", "yaw"])
def test_what_swings_once_in_the_length_of_the_window_is_halved(axis):
    """A raised cosine is that: its mean is 1, and half of it is a cosine of its length."""
    log, w, h = flown(seconds=9.0), 2.0 * np.pi / WINDOW_S, GRID_S
    t = 1e-9 * log.pose.stamp
    swing = 1e-3 * np.sin(w * t)
    half = 0.5 * swing * (axis == "yaw")
    log.pose.position[:, 0] = swing
    log.pose.quat_wxyz[:] = np.column_stack([np.cos(half), 0 * t, 0 * t, np.sin(half)])
    (stretch,) = stretches(log, "swings")
    found, t = stretch.axes[axis], stretch.time
    # Central differences of a sine.
    np.testing.assert_allclose(found.speed, 0.5e-3 * np.sin(w * h) / h * np.cos(w * t), atol=1e-9)
    np.testing.assert_allclose(found.accel, -1e-3 * (1.0 - np.cos(w * h)) / h**2 * np.sin(w * t), atol=1e-7)


@pytest.mark.parametrize(("lost", "pieces"), [(8, 1), (10, 2)])
def test_a_gap_of_more_than_a_tenth_of_a_second_ends_a_stretch(lost, pieces):
    log = flown(seconds=14.0)
    kept = np.ones(1400, bool)
    kept[700 : 700 + lost] = False
    log.pose = SimpleNamespace(**{name: column[kept] for name, column in vars(log.pose).items()})
    assert len([*stretches(log, "gap")]) == pieces


@pytest.mark.parametrize(("height", "pieces"), [(0.19, 0), (0.21, 1)])
def test_who_is_below_twenty_centimetres_is_near_the_floor(height, pieces):
    log = flown(seconds=9.0)
    log.pose.position[:, 2] = height
    assert len([*stretches(log, "low")]) == pieces


def standing(poses):
    """A log of a helicopter that stands in the air, level, to the north."""
    stamp = 10_000_000 * np.arange(poses)
    quat = np.tile([1.0, 0.0, 0.0, 0.0], (poses, 1))
    return SimpleNamespace(pose=SimpleNamespace(stamp=stamp, position=np.ones((poses, 3)), quat_wxyz=quat))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(("off", "turn", "kept"), [(0.0049, 0.049, 20), (0.0051, 0.0, 19), (0.0, 0.051, 19)])
def test_an_outlier_is_five_millimetres_or_a_twentieth_of_a_radian_off(axis, off, turn, kept):
    log = standing(20)
    log.pose.position[7, axis] += off
    log.pose.quat_wxyz[7, [0, 1 + axis]] = np.cos(turn / 2), np.sin(turn / 2)
    assert [len(part) for part in clean_poses(log)] == [kept] * 3


@pytest.mark.parametrize(("poses", "kept"), [(4, 0), (5, 5)])
def test_fewer_than_five_poses_have_no_outliers_and_are_left_out(poses, kept):
    time, position, unit = clean_poses(standing(poses))
    assert (time.shape, position.shape, unit.shape) == ((kept,), (kept, 3), (kept, 4))


def test_a_tilt_pushes_in_proportion_to_the_thrust_over_its_mean():
    log = flown(seconds=9.0)
    log.sent.u[:, 0] = 0.1
    # The poses from 1 s on count: half of the time at each thrust.
    log.sent.u[:, 2] = np.where(log.sent.time < 5e9, 0.4, 0.6)
    (stretch,) = stretches(log, "steps")
    pushed = stretch.axes["x"].input(0.0, 0.0)
    assert pushed[[0, -1]] == pytest.approx([0.1 * 0.4 / 0.5, 0.1 * 0.6 / 0.5], rel=3e-3)


def test_the_second_after_the_first_command_is_left_out_whenever_it_is():
    log = flown(seconds=9.0)
    # The times of the commands are a view of those of the poses.
    log.pose.stamp += 10_000_000_000
    (late,), (early,) = stretches(log, "late"), stretches(flown(seconds=9.0), "early")
    assert late.time[0] == pytest.approx(early.time[0] + 10.0, abs=0.011)


@pytest.mark.parametrize("model", [MODEL, OTHER])
@pytest.mark.parametrize(("heading", "turn"), [(0.0, 0.0), (2.5, 0.0), (-1.0, 0.02)])
def test_a_model_is_recovered_from_its_own_flights(model, heading, turn):
    result = found(*pair(model=model, heading=heading, turn=turn))
    assert tuple(result.parameters) == NAMES
    # The window takes the heading for constant: second order in what it turns within 0.4 s.
    assert max(map(abs, misses(result, model).values())) < 0.002
    # Two flights of 30 s without the first second and half a window at each end.
    assert result.seconds == pytest.approx(57.0, abs=0.01)
    assert all(p.low < getattr(model, name) < p.high for name, p in result.parameters.items())


@pytest.mark.parametrize("late", [3, 11])
def test_a_delay_is_found_and_biases_nothing(late):
    result = found(*pair(late=late))
    assert max(map(abs, misses(result).values())) < 0.002
    for fit in result.fits.values():
        # A tenth of the spacing of the poses.
        assert fit.delay.value == pytest.approx(0.01 * late, abs=0.001)


def test_a_lag_is_part_of_the_delay_and_biases_nothing():
    result = found(*pair(late=2, lag=0.06))
    assert max(map(abs, misses(result).values())) < 0.005
    for fit in result.fits.values():
        # The lagged input is held for 10 ms in the simulation: half of that is more delay.
        assert fit.lag == pytest.approx(0.06, abs=0.003)
        assert fit.delay.value == pytest.approx(0.02 + 0.06 + 0.005, abs=0.003)


def test_a_flight_without_noise_has_the_intervals_of_what_the_model_leaves_out():
    for name, p in found(*pair()).parameters.items():
        # 1 % of the value, and what the sampling of poses leaves.
        assert 0.5 * (p.high - p.low) == pytest.approx(0.01 * abs(p.value), rel=0.3), name
        assert 0.5 * (p.high + p.low) == pytest.approx(p.value)


def test_swapped_markers_and_lost_and_broken_frames_do_no_harm():
    log, other = pair(seconds=60.0)
    position, quat = log.pose.position.copy(), log.pose.quat_wxyz.copy()
    position[300::400] += 0.03
    position[500], quat[900] = np.nan, 0.0
    kept = np.random.default_rng(1).random(len(position)) > 0.02
    kept[2000:2050] = False
    columns = {"stamp": log.pose.stamp, "time": log.pose.time, "position": position, "quat_wxyz": quat}
    log.pose = SimpleNamespace(**{name: column[kept] for name, column in columns.items()})
    first, second = stretches(log, "flight")
    assert second.time[0] - first.time[-1] > MAX_GAP_S
    # Straight lines over the lost frames.
    assert max(map(abs, misses(found(log, other)).values())) < 0.005


def test_more_flights_tell_more():
    rng = np.random.default_rng(0)

    def gusty():
        log = flown(0, 1)
        log.pose.position += np.cumsum(1e-4 * rng.standard_normal(log.pose.position.shape), axis=0)
        return log

    other = flown(2, 3)
    one, three = (found(other, *[gusty() for _ in range(n)]).parameters["k_x"] for n in (1, 3))
    assert three.high - three.low < one.high - one.low


def test_an_axis_that_rests_is_refused_by_name():
    with pytest.raises(
        IdentificationError, match=r"^y is hardly excited: its roll input varies by 0\.000 .* 0\.1 is needed"
    ):
        found(flown(0), flown(2, 3))
    # Another flight may bring what this one lacks.
    assert max(map(abs, misses(found(flown(0), flown(1), flown(2, 3))).values())) < 0.002


def test_reversed_signs_are_told():
    log, other = pair()
    log.sent.u[:, 0] *= -1.0
    with pytest.raises(IdentificationError, match="x accelerates against its input"):
        found(log, other)


def test_logs_without_a_flight_are_refused():
    with pytest.raises(IdentificationError, match="no usable flight in no logs"):
        found()
    with pytest.raises(IdentificationError, match="no usable flight in flight 0"):
        found(flown(0, seconds=3.0))
    grounded = flown(0)
    grounded.pose.position[:, 2] = 0.05
    with pytest.raises(IdentificationError, match="higher than"):
        found(grounded)


@pytest.mark.parametrize("trajectory", [Hover(), Circle()])
def test_flights_that_tell_nothing_are_refused(trajectory):
    experiment = replace(load("lab_simple"), trajectory=trajectory, duration=12.0)
    with pytest.raises(IdentificationError, match=r"x .*is needed"):
        found(fly(experiment, log_dir=None).log)


def test_intervals_know_that_gusts_last():
    rng, n, held, naive = np.random.default_rng(2), 1500, 0, 0
    X = np.column_stack([np.sin(np.arange(n) * 0.1), np.ones(n)])
    for _ in range(200):
        noise = np.convolve(rng.standard_normal(n + 20), np.exp(-np.arange(21) / 7), "valid")
        theta = np.linalg.lstsq(X, noise, rcond=None)[0]
        residual = noise - X @ theta
        held += abs(theta[1]) < half_widths(X, residual, np.array([n]))[1]
        naive += abs(theta[1]) < 1.96 * residual.std() / np.sqrt(n)
    # 95 % less what Newey and West's weights cost at this length; three deviations of 200 draws are 5 %.
    assert held > 0.87 * 200
    assert naive < 0.6 * 200


def test_stretches_share_no_memory():
    X, residual = np.ones((400, 1)), np.tile([1.0, -1.0], 200)
    whole, split = (half_widths(X, residual, np.array(ends))[0] for ends in ([400], [100, 200, 400]))
    assert whole != split
    assert round(MEMORY_S) == 3


@pytest.fixture(scope="module")
def lab_logs(tmp_path_factory):
    planned = [e for e in experiments(load("lab_simple")) if e.seed in (0, PLANE_FLIGHTS)]
    flights = [replace(e, duration=0.6 * e.duration) for e in planned]
    return fly_them(flights, tmp_path_factory.mktemp("flights"))


def test_the_twin_is_identified_through_gusts_noise_and_delay(lab_logs, capsys):
    assert main(["identify", *map(str, lab_logs), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert set(result["parameters"]) == set(NAMES)
    for name, found_here in result["parameters"].items():
        value, (low, high) = found_here["value"], found_here["interval"]
        assert low < value < high
        # A tenth of the flights: k in the plane is known to 6 % (one deviation), the others to 2 %.
        tolerance = 0.15 if name in ("k_x", "k_y") else 0.05
        assert value == pytest.approx(getattr(MODEL, name), rel=tolerance)
        # Seven intervals of 95 %: one may miss, by half its half-width with a chance of one in fifty.
        assert abs(value - getattr(MODEL, name)) < 1.5 * (high - value)
    # Radio and compute are in every axis; attitude in the plane, rotors in z.
    assert (
        0.02 < result["delays"]["yaw"]["value"] < result["delays"]["z"]["value"] < result["delays"]["x"]["value"] < 0.2
    )


def test_the_ideal_plant_is_identified_within_half_a_percent():
    flights = [
        replace(load("ideal"), trajectory=Doublets(axes=axes), duration=20.0) for axes in ("plane", "height_and_yaw")
    ]
    result = found(*[fly(flight, log_dir=None).log for flight in flights])
    assert max(map(abs, misses(result).values())) < 0.005


def test_what_is_saved_flies(lab_logs, tmp_path, capsys, rise_version):
    assert (
        main(["identify", *map(str, lab_logs), "--out", str(tmp_path), "--save", str(tmp_path / "a" / "mine.toml")])
        == 0
    )
    printed = capsys.readouterr().out
    assert {"model.toml", "residuals-x.svg"} <= {path.name for path in tmp_path.iterdir()}
    saved = tmp_path / "a" / "mine.toml"
    assert saved.read_text() == (tmp_path / "model.toml").read_text()
    alone = load(str(saved)).controller.model
    assert alone != MODEL
    assert f"{alone.b_x:.4g}" in printed
    assert load("ideal", [f"controller.model={saved}"]).controller.model == alone
    as_saved = load(str(saved))
    assert load("lab", [f"controller.model={saved}"]) == as_saved
    rise_version()
    assert load("lab", [f"controller.model={saved}"]) == as_saved


def test_residual_plots_are_the_same_every_time(tmp_path):
    figures = residual_figures(found(*pair()))
    assert [figure.name for figure in figures] == ["residuals-x", "residuals-y", "residuals-z", "residuals-yaw"]
    for name in ("one.svg", "two.svg"):
        write_svg(figures[0], tmp_path / name)
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()


def test_logs_and_an_experiment_together_are_a_mistake(lab_logs, capsys):
    assert main(["identify", str(lab_logs[0]), "plant.mass=0.03"]) == 2
    assert "give logs or an experiment to fly, not both: 'plant.mass=0.03'" in capsys.readouterr().err


def test_every_flight_has_gusts_of_its_own():
    flights = experiments(load("lab_simple", ["seed=5", "trajectory=doublets", "trajectory.x=0.5"]))
    assert [e.seed for e in flights] == list(range(5, 5 + PLANE_FLIGHTS + HEIGHT_AND_YAW_FLIGHTS))
    assert {e.trajectory.x for e in flights} == {0.5}


def test_a_table_of_a_file_that_lacks_it_is_told(tmp_path, capsys):
    file = tmp_path / "other.toml"
    file.write_text("[plant]\nmass = 0.03\n")
    assert main(["show", f"controller.model={file}"]) == 2
    assert f"{file} has no table [controller.model]" in capsys.readouterr().err
