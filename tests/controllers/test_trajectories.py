from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.flatness import feed_forward, state
from controllers.model import Model, rates
from controllers.pace import ride_duration, smooth_ride, smooth_start
from controllers.reference import check_feasible
from controllers.trajectories import fitted
from controllers.trajectories.circle import Circle
from controllers.trajectories.csv import Csv
from controllers.trajectories.doublets import Doublets
from controllers.trajectories.ferris_wheel import FerrisWheel
from controllers.trajectories.hover import Hover
from controllers.trajectories.lemniscate import Lemniscate
from controllers.trajectories.pirouette import Pirouette
from controllers.trajectories.pirouette_circle import PirouetteCircle
from controllers.trajectories.takeoff_and_landing import TakeoffAndLanding
from controllers.trajectories.waypoints import Waypoints
from heli_twin.experiment.families import members
from heli_twin.experiment.text import load
from heli_twin.experiment.tree import ExperimentError, canonical_json, from_json, toml_of
from heli_twin.mission import fly

KINDS = members("controllers.trajectories")
MODEL = Model()
STEP = 1e-4
T = np.arange(STEP, 40.0, 0.0137)

each = pytest.mark.parametrize("kind", KINDS)


def of(kind):
    return fitted(KINDS[kind](), MODEL)


def slope(values):
    """Central difference of a function of time at T."""
    return (values(T + STEP) - values(T - STEP)) / (2.0 * STEP)


@each
def test_derivatives_match_finite_differences(kind):
    flat = of(kind).flat
    # Half the step squared times the third derivative (below 50 in these flights) is 3e-7; where that one jumps, at
    # the end of a ramp or a leg, the step times the jump: 1e-3 at most.
    np.testing.assert_allclose(slope(lambda t: flat(t).z), flat(T).dz, atol=1e-6)
    np.testing.assert_allclose(slope(lambda t: flat(t).dz), flat(T).ddz, atol=1e-3)


@each
def test_the_flat_reference_satisfies_the_dynamics(kind):
    flat = of(kind).flat
    x, u = state(flat(T)), feed_forward(MODEL, flat(T))
    expected = np.array([rates(MODEL, tuple(a), tuple(b)) for a, b in zip(x.tolist(), u.tolist(), strict=True)])
    # As above.
    np.testing.assert_allclose(slope(lambda t: state(flat(t))), expected, atol=1e-3)


@each
def test_defaults_are_feasible(kind):
    check_feasible(KINDS[kind](), MODEL, 60.0, 0.02)


@each
def test_defaults_start_at_rest(kind):
    flat = of(kind).flat(np.zeros(1))
    np.testing.assert_array_equal(flat.dz, 0.0)
    # The first command is a hover: nothing jumps.
    np.testing.assert_allclose(feed_forward(MODEL, flat)[0], MODEL.u_hover, atol=1e-12)


@each
def test_every_time_has_a_finite_point_above_the_floor(kind):
    t = np.concatenate([[0.0], np.geomspace(1e-9, 36_000.0, 2000)])
    flat = of(kind).flat(t)
    for values in flat:
        assert values.shape == (len(t), 4)
        assert np.isfinite(values).all()
    assert (flat.z[:, 2] > 0.0).all()


@each
def test_a_point_does_not_depend_on_which_others_are_asked_for(kind):
    flat, t = of(kind).flat, np.linspace(0.0, 40.0, 101)
    for i in (0, 37, 100):
        # Vectorised sines may differ in their last digit.
        np.testing.assert_allclose(flat(t[i : i + 1]).z[0], flat(t).z[i], rtol=0, atol=1e-13)


@each
def test_the_first_heading_is_one_that_a_camera_reports(kind):
    assert -pi < of(kind).flat(np.zeros(1)).z[0, 3] <= pi


@given(st.floats(0.01, 100.0), st.floats(0.0, 10.0))
def test_a_ride_covers_its_length_and_stands_still_before_and_after(length, ramp):
    end = ride_duration(length, ramp)
    reading, speed, acceleration = smooth_ride(np.array([-1.0, 0.5 * end, end + 1e-6, end + 100.0]), length, ramp)
    np.testing.assert_allclose(reading, [0.0, 0.5 * length, length, length], rtol=1e-12)
    np.testing.assert_allclose(speed[[0, 2, 3]], 0.0)
    np.testing.assert_allclose(acceleration[[0, 2, 3]], 0.0)
    # Below full speed only where a ramp as long as the ride leaves no time for it.
    assert speed[1] == pytest.approx(1.0)


@given(st.floats(0.0, 5.0), st.floats(0.0, 20.0))
def test_a_ride_starts_like_a_start(ramp, t):
    ride, start = smooth_ride(np.array([t]), 100.0, ramp), smooth_start(np.array([t]), ramp)
    np.testing.assert_array_equal(ride, start)


def test_the_shapes_are_what_their_names_say():
    north, west, height = np.moveaxis(FerrisWheel(radius=0.4, direction=0.7, height=1.2).flat(T).z[:, :3], 1, 0)
    # Rounding in sines and a square.
    np.testing.assert_allclose(north**2 + west**2 + (height - 1.2) ** 2, 0.16, rtol=1e-12)
    np.testing.assert_allclose(np.cos(0.7) * west, np.sin(0.7) * north, atol=1e-15)
    figure = Lemniscate(length=1.2, width=0.5).flat(T).z / [0.6, 0.25, 1.0, 1.0]
    # Gerono: y = 2 x sqrt(1 - x^2), squared so that it holds on both lobes.
    np.testing.assert_allclose(figure[:, 1] ** 2, 4 * figure[:, 0] ** 2 * (1 - figure[:, 0] ** 2), atol=1e-12)
    circle = Circle(radius=0.4, rate=0.5, ramp=0.0, x=0.3, y=-0.2, phase=0.7, height=1.1).flat(T).z
    angle = 0.7 + 0.5 * T
    around = np.stack([0.3 + 0.4 * np.cos(angle), -0.2 + 0.4 * np.sin(angle), np.full(len(T), 1.1)], axis=1)
    np.testing.assert_allclose(circle[:, :3], around, atol=1e-12)
    spot = Pirouette(x=0.2, y=-0.1, rate=-2.0).flat(T).z
    np.testing.assert_array_equal(spot[:, :3], np.tile([0.2, -0.1, 1.0], (len(T), 1)))
    ring = PirouetteCircle(radius=0.3, rate=0.5, yaw_rate=-1.0).flat(T).z
    np.testing.assert_allclose(np.hypot(ring[:, 0], ring[:, 1]), 0.3, rtol=1e-12)
    np.testing.assert_allclose(ring[:, 3], -2.0 * np.unwrap(np.arctan2(ring[:, 1], ring[:, 0])), atol=1e-9)


def test_defaults_are_the_paper_s_where_it_names_them():
    # Kunz, Huck, Summers, ECC 2013, Figs. 3 to 5: a hover, and a circle of 0.5 m with its nose along the path.
    assert (Circle().radius, Circle().heading) == (0.5, "path")
    assert (Lemniscate().rate, PirouetteCircle().rate, PirouetteCircle().yaw_rate) == (0.8, 0.8, 1.6)
    # 2 s of smooth start: along the path the standing start costs half of it.
    for trajectory in (Circle(), Lemniscate(), FerrisWheel(), Pirouette(), PirouetteCircle()):
        assert trajectory.ramp == 2.0


def test_the_default_waypoints_go_round_a_square():
    x, y, z, yaw = np.array(Waypoints().points).T
    np.testing.assert_array_equal(np.stack([x, y]), 0.8 * np.array([[0, 1, 1, 0, 0], [0, 0, 1, 1, 0]]))
    np.testing.assert_array_equal(z, [0.8, 1.2, 1.2, 0.8, 0.8])
    np.testing.assert_allclose(yaw, [0, 0, pi / 2, pi, 0], atol=1e-5)


def test_doublets_of_all_axes_are_those_of_each():
    t, peaks = np.arange(0.0, 20.0, 0.01), {"x": 0.6, "y": 0.5, "yaw": 8.0}
    every, plane, rest = (Doublets(axes=axes, **peaks).derivatives(t, 3) for axes in ("all", "plane", "height_and_yaw"))
    assert np.array_equal(every[..., :2], plane[..., :2])
    assert np.array_equal(every[..., 2:], rest[..., 2:])
    held = Doublets(axes="all", yaw=0.0).derivatives(t, 3)
    assert not held[..., 3].any()
    assert held[2, :, :3].any(axis=0).all()


def test_a_doublet_moves_by_its_acceleration_and_the_second_pair_is_shorter():
    flat = Doublets(x=1.0, y=0.5, plane_pulse=2.0, edge=0.25).flat(np.array([0.0, 4.0, 8.0, 10.8, 13.6]))
    # From rest to rest in two pulses T by a (1 - edge) T^2 = 3 m, and with 0.7 T by 0.49 of it; midway is the origin.
    x = [-1.5, 1.5, -1.5, -1.5 + 0.49 * 3.0, -1.5]
    np.testing.assert_allclose(flat.z, np.column_stack([x, 0.5 * np.array(x), np.ones(5), np.zeros(5)]), atol=1e-12)
    np.testing.assert_allclose(flat.dz, 0.0, atol=1e-12)
    pulse = Doublets(x=1.0, plane_pulse=2.0, edge=0.25).flat(np.array([0.25, 0.5, 1.5, 2.0, 3.0])).ddz[:, 0]
    # Ramps of 0.5 s: half the acceleration after 0.25 s.
    np.testing.assert_allclose(pulse, [0.5, 1.0, 1.0, 0.0, -1.0], atol=1e-12)


@pytest.mark.parametrize("rate", [0.8, -0.8])
@pytest.mark.parametrize("trajectory", [Circle(), Lemniscate()], ids=["circle", "lemniscate"])
def test_nose_along_the_path_means_no_sideways_speed(trajectory, rate):
    x = state(replace(trajectory, rate=rate).flat(T))
    assert (x[:, 4] >= 0.0).all()
    # Rounding of a product of sines.
    np.testing.assert_allclose(x[:, 5], 0.0, atol=1e-14)


@pytest.mark.parametrize("corners", ["stop", "pass"])
def test_waypoints_are_met_at_their_times(corners):
    flight = fitted(Waypoints(corners=corners), MODEL)
    flat = flight.flat(np.array(flight.times))
    # The last digit of a polynomial.
    np.testing.assert_allclose(flat.z, flight.points, atol=1e-12)
    stops = slice(None) if corners == "stop" else [0, -1]
    np.testing.assert_allclose(flat.dz[stops], 0.0, atol=1e-12)
    if corners == "pass":
        assert (np.abs(flat.dz[1:-1]).max(axis=1) > 0.1).all()


@given(
    # High up: a curve that passes its corners swings beyond them, and no timing keeps it off the floor.
    st.lists(st.tuples(*[st.floats(-2, 2)] * 2, st.floats(4, 5), st.floats(-7, 7)), min_size=2, max_size=5),
    st.sampled_from(["stop", "pass"]),
    st.floats(0.1, 0.9),
    st.floats(0.2, 3.0),
    st.floats(0.6, 1.0),
)
@settings(max_examples=20)
def test_chosen_times_keep_the_believed_limits(points, corners, effort, vx_max, u_z_max):
    # Limits of all kinds, up to a helicopter that can hardly climb.
    model = Model(vx_max=vx_max, u_z_max=u_z_max, u_yaw_max=0.1)
    flight = fitted(Waypoints(points=tuple(points), corners=corners, effort=effort), model)
    check_feasible(flight, model, flight.times[-1] + 1.0, 0.02)


def test_chosen_times_use_the_effort_they_may():
    for model in (MODEL, Model(vx_max=0.2), Model(u_yaw_max=0.05)):
        flight = fitted(Waypoints(effort=0.5), model)
        flat = flight.flat(np.linspace(0.0, flight.times[-1], 20_000))
        beyond = np.abs(feed_forward(model, flat) - model.u_hover) / (np.array(model.u_max) - model.u_hover)
        share = max(beyond.max(), (np.abs(state(flat)[:, 4:]) / model.v_max).max())
        # 64 samples a leg miss the very peak by 0.2 %; the search stops within 0.1 %; times are whole milliseconds.
        assert share == pytest.approx(0.5, rel=0.01)


def test_times_of_ones_own_are_kept():
    flight = Waypoints(points=((0, 0, 1, 0), (1, 0, 1, 0)), times=(0.0, 7.0))
    assert fitted(flight, Model(vx_max=0.01)) is flight


@pytest.mark.parametrize(
    "times", [(0.0, 1.0), (1.0, 2.0, 3.0, 4.0, 5.0), (0.0, 1.0, 1.0, 2.0, 3.0), (0.0, 1.0, 2.0, 3.0, np.inf)]
)
def test_times_that_cannot_be_kept_are_refused(times):
    with pytest.raises(ValueError, match=r"^times "):
        Waypoints(times=times)


def test_rows_are_met_at_their_times_and_turned_the_short_way():
    rows = ((5.0, 0.0, 0.0, 1.0, 3.0), (7.0, 0.5, 0.1, 1.2, -3.0), (9.0, 0.4, 0.3, 1.0, -2.0))
    z = Csv(rows=rows).flat(np.array([0.0, 2.0, 4.0, 50.0])).z
    expected = np.array([*rows, rows[-1]])[:, 1:]
    expected[1:, 3] += 2.0 * pi
    # The last digit of a polynomial.
    np.testing.assert_allclose(z, expected, atol=1e-12)


def test_rows_out_of_order_are_refused():
    with pytest.raises(ValueError, match=r"rows\[2\]"):
        Csv(rows=((0, 0, 0, 1, 0), (1, 0, 0, 1, 0), (1, 0, 0, 1, 0)))


def test_sampled_rows_are_the_flight_they_were_taken_from():
    times = np.arange(0.0, 10.0, 0.05)
    circle = Circle(ramp=0.0)
    rows = tuple(map(tuple, np.column_stack([times, circle.flat(times).z]).tolist()))
    flown, expected = Csv(rows=rows, ramp=1.0).flat(np.array([5.5])), circle.flat(np.array([5.0]))
    # Parabolas through 50 ms of a 0.5 m circle: h^2 / 6 = 4e-4 of the velocity, h^2 / 12 of the acceleration; a
    # position in the middle between two rows would differ by their error times h / 4.
    np.testing.assert_allclose(flown.z, expected.z, atol=1e-9)
    np.testing.assert_allclose(flown.dz, expected.dz, atol=5e-4)
    np.testing.assert_allclose(flown.ddz, expected.ddz, atol=5e-4)
    check_feasible(Csv(rows=rows, ramp=1.0), MODEL, 15.0, 0.02)


def test_a_csv_file_becomes_part_of_the_experiment(tmp_path):
    file = tmp_path / "flight.csv"
    file.write_text("yaw, t, note, x, y, z\n0, 0, up, 0, 0, 1\n0.5, 2, , 0.5, 0, 1.2\n")
    experiment = load(overrides=["trajectory=csv", f"trajectory.rows={file}"])
    file.unlink()
    assert experiment.trajectory == Csv(rows=((0.0, 0.0, 0.0, 1.0, 0.0), (2.0, 0.5, 0.0, 1.2, 0.5)))
    assert from_json(canonical_json(experiment)) == experiment
    own = tmp_path / "own.toml"
    own.write_text(toml_of(experiment))
    assert load(str(own)) == experiment


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("t,x,y,z\n0,0,0,1\n", "no column yaw"),
        ("t,x,y,z,yaw\n0,0,0,1,0\n1,0,0,one,0\n", "line 3 is not a row of numbers"),
        ("t,x,y,z,yaw\n0,0,0,1,0\n1,0,0\n", "line 3 is not a row of numbers"),
        ("t,x,y,z,yaw\n0,0,0,1,0\n1,0,0,nan,0\n", "not a finite number"),
        ("t,x,y,z,yaw\n0,0,0,1,0\n", "at least 2"),
    ],
)
def test_a_csv_file_that_is_no_flight_says_where(tmp_path, text, complaint):
    file = tmp_path / "flight.csv"
    file.write_text(text)
    with pytest.raises(ExperimentError, match=complaint):
        load(overrides=["trajectory=csv", f"trajectory.rows={file}"])


@pytest.mark.parametrize("kind", [k for k in KINDS if k != "takeoff_and_landing"])
def test_takeoff_and_landing_surround_any_flight(kind):
    inner = of(kind)
    flight = TakeoffAndLanding(flight=inner, airborne=6.0, climb=3.0, ramp=1.0)
    flat = flight.flat(flight.stand + np.array([-1.0, 3.0, 6.5, 10.0, 13.0, 99.0]))
    path = inner.flat(np.array([0.0, 3.0, 6.0])).z
    floor = path * [1, 1, 0, 1] + [0, 0, flight.floor, 0]
    # Sums of heights round once.
    np.testing.assert_allclose(flat.z, [floor[0], path[0], path[1], path[2], floor[2], floor[2]], atol=1e-12)
    np.testing.assert_allclose(flat.dz[[0, 1, 3, 4, 5]], 0.0, atol=1e-12)
    height = flight.flat(flight.stand + np.linspace(0.0, 3.0, 100)).z[:, 2]
    assert (np.diff(height) > 0.0).all()


@pytest.mark.parametrize("preset", ["lab", "lab_simple"])
@pytest.mark.parametrize("law", ["ltv_mpc", "pid"])
def test_the_twin_takes_off_and_lands(law, preset):
    experiment = load(preset, ["trajectory=takeoff_and_landing", f"controller={law}", "duration=12"])
    flight = TakeoffAndLanding(flight=Hover(height=0.8), airborne=2.0, ramp=1.0)
    result = fly(replace(experiment, trajectory=flight), log_dir=None)
    assert result.outcome.kind == ("landed" if preset == "lab" else "completed"), result.outcome.text
    height = result.log.truth.position[:, 2]
    assert height.max() > 0.7
    # It stands on its skids, which give way by a millimetre; unsupervised, it may float a gust's lift above them.
    assert height[-1] == pytest.approx(flight.floor, abs=0.001 if preset == "lab" else 0.03)


def test_legs_between_stops_take_as_long_as_each_alone():
    rows = ((0.0, 0.0, 1.0, 0.0), (0.5, 0.0, 1.0, 0.0), (0.5, 1.5, 1.2, 1.0))
    whole = Waypoints(points=rows, corners="stop").fitted(MODEL).times
    alone = [Waypoints(points=rows[i : i + 2], corners="stop").fitted(MODEL).times[1] for i in (0, 1)]
    assert whole == pytest.approx((0.0, alone[0], alone[0] + alone[1]), abs=1e-9)
