"""A helicopter of a user's own: an MJCF that keeps the contract flies here, and is logged and drawn like ours."""

import json
from dataclasses import replace
from math import sqrt

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from quadrotor import B_X, B_YAW, B_Z, BELIEVED, QUADROTOR, SECOND, TEXT, UP, changed, held

from controllers.model import GRAVITY
from heli_twin import Experiment, HeliTwinError, fly, load, read_log
from heli_twin.cli import main
from heli_twin.experiment.tree import canonical_json, from_json, toml_of
from heli_twin.lab.plant import STILL_AIR, Air, physical_state
from heli_twin.lab.plant.airframe import Airframe, _rpy, shape_of
from heli_twin.lab.plant.mjcf_text import MAX_MESH_BYTES, MAX_TEXT_BYTES
from heli_twin.lab.plant.mujoco import MuJoCo, model_file
from heli_twin.lab.plant.shape import Primitive

# --- it flies -------------------------------------------------------------------------------------------------------


def test_hover_is_an_equilibrium():
    np.testing.assert_allclose(physical_state(held(0.0, 5.0)), UP, atol=1e-9)


def test_it_starts_in_the_state_it_is_given_with_whole_turns():
    x = np.array([0.3, -0.2, 1.0, 15.5, 0.5, -0.4, 0.1, 1.5])
    np.testing.assert_allclose(physical_state(Airframe(model=TEXT).start(x).truth()), x, atol=1e-12)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_heading_is_counted_over_full_turns(way):
    """5 rad/s for 4 s in one piece are more than three turns."""
    turned = held([0, 0, 0, way], 4.0)
    pieces = Airframe(model=TEXT).start(UP)
    headings = [pieces.truth().yaw]
    for t in range(1, 401):
        pieces.advance(t * SECOND // 100, np.array([0, 0, 0.4905, way]), STILL_AIR)
        headings.append(pieces.truth().yaw)
    # At 5 rad/s and every 10 ms, without a jump.
    assert np.abs(np.diff(headings)).max() < 0.06
    assert way * turned.yaw > 5.5 * np.pi
    assert turned.yaw == pieces.truth().yaw


def test_yaw_rate_is_the_derivative_of_yaw_in_a_tilt():
    plant = Airframe(model=TEXT).start(UP)
    plant.advance(SECOND, np.array([0.8, -0.6, 0.49, 0.3]), STILL_AIR)
    before = plant.truth()
    plant.advance(SECOND + 1_000_000, np.array([0.8, -0.6, 0.49, 0.3]), STILL_AIR)
    after = plant.truth()
    # Half a step of a rate that changes by some rad/s^2.
    assert (after.yaw - before.yaw) / 1e-3 == pytest.approx(after.yaw_rate, abs=5e-3)


@pytest.mark.parametrize(("stick", "expected"), [(0, B_X), (1, B_X), (2, B_Z), (3, B_YAW)])
def test_the_sticks_act_as_the_file_says(stick, expected):
    """Once the lags are over: the acceleration per stick of the paper's model, less the drag."""
    u = 0.02 * np.eye(4)[stick]
    times = (0.8, 1.2) if stick < 3 else (0.3, 0.35)
    first, last = (held(u, t, x=np.array([0, 0, 50.0, 0, 0, 0, 0, 0])) for t in times)
    rates = [(*truth.velocity, truth.yaw_rate)[stick] for truth in (first, last)]
    drag = 0.2 if stick < 3 else 5.8
    found = (rates[1] - rates[0]) / (times[1] - times[0]) / 0.02 + drag * sum(rates) / 2 / 0.02
    # Attitude 20 rad/s with a damping ratio of 0.7 has settled to 1 % after 0.4 s, lags of 20 and 40 ms long before.
    assert found == pytest.approx(expected, rel=0.05)


def test_only_the_sticks_are_delayed():
    model = Airframe(model=TEXT, input_delay=0.007).start(UP)._model
    np.testing.assert_allclose(model.actuator_delay, [0.007] * 4 + [0.0] * 5)


def test_a_stick_without_dynamics_acts_at_once():
    quick = Airframe(model=changed(('dynprm="0.04"', 'dyntype="none" actearly="false" dynprm="1"')))
    climb = held(0.1 * np.eye(4)[2], 0.05, quick).velocity[2]
    assert climb == pytest.approx(0.1 * B_Z * (0.05 - quick.input_delay), rel=0.02)


def test_wind_blows_through_the_engines_medium_and_a_push_is_an_acceleration():
    blown = held(0.0, 1.0, air=Air(np.array([2.0, 0, 0]), np.zeros(3)))
    pushed = held(0.0, 1.0, air=Air(np.zeros(3), np.array([0, 0.3, 0])))
    assert blown.velocity[0] == pytest.approx(2.0 * (1 - np.exp(-0.2)), rel=0.1)
    assert pushed.velocity[1] == pytest.approx(0.3, rel=0.1)


def test_a_failed_gyro_damps_no_yaw():
    plant = Airframe(model=TEXT).start(UP)
    plant.gyro_works = False
    plant.advance(2 * SECOND, np.array([0, 0, 0.4905, 0.1]), STILL_AIR)
    # With the gyro it would be b_yaw u / 5.7; what is left of b_yaw u t is the medium's.
    assert 5.0 * B_YAW * 0.1 / 5.7 < plant.truth().yaw_rate < B_YAW * 0.1 * 2.0
    plant.gyro_works = True
    plant.advance(4 * SECOND, np.array([0, 0, 0.4905, 0.1]), STILL_AIR)
    assert plant.truth().yaw_rate == pytest.approx(B_YAW * 0.1 / 5.9, rel=0.02)


def test_it_stands_on_its_feet_and_another_body_that_lies_there_is_not_it():
    ball = '<body name="ball" pos="0.5 0 0.0199"><freejoint/><geom size="0.02" mass="0.01" contype="1"/></body>'
    spec = Airframe(model=changed(("</worldbody>", f"{ball}</worldbody>")))
    assert not held(0.0, 0.2, spec).touching
    assert held([0, 0, -0.4905, 0], 1.0, spec, np.array([0, 0, 0.03, 0, 0, 0, 0, 0.0])).touching


def test_the_longest_foot_stands_in_the_floor_first():
    uneven = Airframe(model=changed(("0.05 0.05 -0.02", "0.05 0.05 -0.03")))
    with pytest.raises(ValueError, match=r"at a height of 0\.022 m the helicopter would stand 0\.011 m in the floor"):
        uneven.start(np.array([0, 0, 0.022, 0, 0, 0, 0, 0.0]))


def test_a_model_that_diverges_is_an_outcome(tmp_path, capsys):
    wild = tmp_path / "wild.xml"
    wild.write_text(changed(('biasprm="0 0 -0.0011"', 'biasprm="0 0 -50"'), ("implicitfast", "Euler")))
    assert main(["fly", f"plant.model={wild}", "duration=2", "--no-log", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["outcome"] == "diverged"


@pytest.mark.parametrize("law", ["ltv_mpc", "pid"])
def test_a_quadrotor_flies_the_circle_on_what_is_believed_of_it(law):
    known = load("lab_simple", [f"plant.model={QUADROTOR}", f"controller={law}", "duration=6"])
    believed = replace(known, controller=replace(known.controller, model=BELIEVED))
    right, wrong = (fly(e, log_dir=None).summary() for e in (believed, known))
    assert right["outcome"] == "completed"
    assert right["rmse"]["z"] < 0.02
    if law == "ltv_mpc":
        assert all(right["rmse"][axis] < 0.5 * wrong["rmse"][axis] for axis in ("x", "y", "z", "yaw"))


def test_a_single_rotor_flies_whose_tail_holds_against_its_torque():
    """0.5 mm of torque per thrust need -0.14 of the yaw stick in hover, which the controller has to find."""
    trim = -0.0005 * 0.060 * GRAVITY / 0.0021
    heli = changed(
        ('name="u_z" site="cog" gear="0 0 1 0 0 0"', 'name="u_z" site="cog" gear="0 0 1 0 0 0.0005"'),
        ("0 0 0.4905 0", f"0 0 0.4905 {trim}"),
    )
    np.testing.assert_allclose(physical_state(held(0.0, 2.0, Airframe(model=heli))), UP, atol=1e-9)
    base = load("lab_simple", ["duration=4", "trajectory=hover", "controller.offset_free=all"])
    controller = replace(base.controller, model=BELIEVED)
    flown = fly(replace(base, plant=Airframe(model=heli), controller=controller), log_dir=None)
    # What is left of 0.13 rad, which it is off without offset_free.
    assert flown.summary()["max_abs_error"]["yaw"] < 0.03
    assert flown.log.sent.u[-50:, 3].mean() == pytest.approx(trim, rel=0.1)


# --- the mCX2 as a user's own ---------------------------------------------------------------------------------------


def mcx2(p: MuJoCo) -> str:
    """models/mcx2.xml with every digit of the parameters."""
    stiffness = p.inertia_yy * p.attitude_frequency**2
    damping, force = 2.0 * p.attitude_damping * sqrt(stiffness), stiffness / 0.041
    text = model_file().read_text()
    for old, new in (
        ('mass="0.028"', f'mass="{p.mass - 1e-12!r}"'),
        ('"1.5584e-3"', f'"{stiffness * p.pitch_gain!r}"'),
        ('"1.63633e-3"', f'"{stiffness * p.roll_gain!r}"'),
        ('"5.46e-4"', f'"{damping * sqrt(p.inertia_yy)!r}"'),
        ('"4.6264e-4"', f'"{damping * sqrt(p.inertia_xx)!r}"'),
        ('"0.186439"', f'"{force!r}"'),
        ('"-0.186439"', f'"{-force!r}"'),
        ("0 0 0.545 0 0", f"0 0 {p.trim[2]!r} 0 0"),
    ):
        assert old in text
        text = text.replace(old, new)
    return text


def test_the_mcx2_as_a_users_own_flies_the_same_flight_to_the_last_digit():
    ours = load("lab_simple", ["duration=3"])
    theirs = replace(ours, plant=Airframe(model=mcx2(MuJoCo())))
    a, b = (fly(e, log_dir=None).log for e in (ours, theirs))
    for topic in ("/truth", "/mocap/pose", "/command/sent", "/mpc/plan"):
        assert a.messages[topic].data == b.messages[topic].data, topic


def test_the_file_of_the_mcx2_flies_the_same_flight_within_its_digits():
    """It has five digits, in which its trim is wrong by 1e-6 of its weight."""
    ours = fly(load("lab_simple", ["duration=3"]), log_dir=None).log
    theirs = fly(load("lab_simple", ["duration=3", f"plant.model={model_file()}"]), log_dir=None).log
    np.testing.assert_allclose(theirs.truth.position, ours.truth.position, atol=1e-4)


def test_effects_act_on_the_mcx2_of_a_user_as_on_ours():
    effects = ["plant.effects.hub_drag=on", "plant.effects.battery=on", "plant.effects.ground_effect=on"]
    ours = load("lab_simple", ["duration=2", *effects])
    theirs = replace(ours, plant=Airframe(model=mcx2(MuJoCo()), effects=ours.plant.effects))
    a, b = (fly(e, log_dir=None).log for e in (ours, theirs))
    assert a.messages["/truth"].data == b.messages["/truth"].data
    assert a.messages["/battery"].data == b.messages["/battery"].data


def test_an_effect_names_what_it_needs():
    for effect, needs in (("hub_drag", "site 'mast'"), ("payload", "joint 'air_x'"), ("stabiliser_bar", "site 'mast'")):
        with pytest.raises(HeliTwinError, match=rf"effects\.{effect} needs the {needs}"):
            fly(load("lab", [f"plant.model={QUADROTOR}", f"plant.effects.{effect}=on"]), log_dir=None)


# --- its text is a part of the experiment ---------------------------------------------------------------------------


def test_every_way_to_give_it_is_the_same_experiment(tmp_path):
    (tmp_path / "mine.toml").write_text('[plant]\nmodel = "./quad.xml"\ninput_delay = 0.002\n')
    (tmp_path / "quad.xml").write_text(TEXT)
    ways = [
        load("lab", [f"plant.model={QUADROTOR}"]),
        load("lab", ["plant.input_delay=0.002", f"plant.model={QUADROTOR}", "plant.kind=airframe"]),
        load("ideal", [f"plant.model={QUADROTOR}"]),
        load(str(tmp_path / "mine.toml")),
        Experiment(plant=Airframe(model=TEXT)),
        Experiment(plant=Airframe(model=QUADROTOR)),
    ]
    assert len({e.plant for e in ways}) == 1


def test_comments_and_pictures_change_no_experiment_and_a_number_does():
    same = changed(("<worldbody>", '<visual><global azimuth="10"/></visual><!-- a note -->   <worldbody>'))
    assert Airframe(model=same) == Airframe(model=TEXT)
    assert Airframe(model=changed(('mass="0.060"', 'mass="0.061"'))) != Airframe(model=TEXT)


def test_what_show_prints_is_the_same_experiment(tmp_path):
    strange = changed(('model="test quadrotor"', 'model="&quot;&quot;&quot; \\ \u202e \U0001f681"'))
    for text in (TEXT, strange):
        experiment = Experiment(plant=Airframe(model=text))
        (tmp_path / "shown.toml").write_text(toml_of(experiment), encoding="utf-8")
        assert load(str(tmp_path / "shown.toml")) == experiment
        assert from_json(canonical_json(experiment)) == experiment


def test_a_log_needs_no_file(tmp_path, capsys, monkeypatch):
    mine = tmp_path / "secret folder" / "quad.xml"
    mine.parent.mkdir()
    mine.write_text(TEXT)
    assert main(["fly", f"plant.model={mine}", "duration=1", "--log-dir", str(tmp_path)]) == 0
    mine.unlink()
    (run,) = tmp_path.glob("*.mcap")
    assert b"secret folder" not in run.read_bytes()
    capsys.readouterr()
    assert main(["refly", str(run)]) == 0
    assert "identical" in capsys.readouterr().out
    assert main(["info", str(run)]) == 0
    assert 'plant.model=<mujoco model="test quadrotor"> #' in capsys.readouterr().out
    assert main(["replay", str(run), "--save", str(tmp_path / "x.rrd")]) == 0
    log = read_log(run)
    assert "plant.xml" in log.attachments


def test_a_path_in_a_log_is_not_followed(tmp_path):
    tree = json.loads(canonical_json(load("lab", [f"plant.model={QUADROTOR}"])))
    for value in (str(QUADROTOR), "./quadrotor.xml", "/etc/passwd"):
        tree["plant"]["model"] = value
        with pytest.raises(HeliTwinError, match=r"plant\.model is no MJCF: give the name of a file"):
            from_json(json.dumps(tree))


def test_it_is_drawn_from_its_geoms():
    log = fly(load("lab", [f"plant.model={QUADROTOR}", "duration=0.1"]), log_dir=None).log
    (urdf,) = log.messages["/robot_description"].data
    # 1 deck, 4 propellers and, of 6 capsules, a cylinder each; 1 nose and 12 ends of capsules; the tail as a box.
    assert [urdf.count(f"<{kind} ".encode()) for kind in ("box", "cylinder", "sphere")] == [2, 10, 13]
    assert b"mCX2" not in urdf
    shape = Airframe(model=TEXT).shape()
    prop = next(part for part in shape if part.colour == 0x33BFF28C and part.centre[0] > 0 and part.centre[1] > 0)
    assert (prop.kind, prop.size, prop.centre) == ("cylinder", (0.032, 0.002), pytest.approx((0.05, 0.05, 0.01)))
    foot = next(part for part in shape if part.kind == "cylinder" and part.size[0] == pytest.approx(0.003))
    # The first of the materials, 0.15 0.16 0.18.
    assert foot.colour == 0x26292EFF
    assert (foot.size, foot.centre) == (pytest.approx((0.003, 0.02)), pytest.approx((0.05, 0.05, -0.01)))
    ends = [part.centre for part in shape if part.kind == "sphere" and part.size == pytest.approx((0.003,))]
    assert sorted(z for x, y, z in ends if x > 0 and y > 0) == pytest.approx([-0.02, 0.0])


def test_a_text_that_does_not_compile_is_drawn_as_a_ball():
    """A log is foreign, and can be looked at all the same."""
    (ball,) = shape_of(Airframe(model="<mujoco/>"))
    assert ball == Primitive("sphere", (0.05,), (0.0, 0.0, 0.0), 0xA0A4ABFF)
    assert shape_of(MuJoCo()) == ()


def test_a_colour_beyond_the_range_is_the_end_of_it():
    parts = shape_of(Airframe(model=changed(('rgba="0.9 0.1 0.1 1"', 'rgba="1.3 -0.3 0.2 1"'))))
    assert next(part.colour for part in parts if part.size == (0.007,)) == 0xFF0033FF


def test_shapes_have_whole_sizes():
    """MJCF has half sizes of boxes and half lengths of cylinders."""
    parts = shape_of(Airframe(model=TEXT))
    assert next(part.size for part in parts if part.kind == "box") == pytest.approx((0.056, 0.040, 0.016))
    assert [part.size for part in parts if part.kind == "cylinder"][-1] == pytest.approx((0.032, 0.002))
    assert next(part.size for part in parts if part.kind == "ellipsoid") == pytest.approx((0.016, 0.003, 0.008))


@given(*[st.floats(-3.1, 3.1)] * 3)
@example(0.0, np.pi / 2, 0.7)
@example(1.2, -np.pi / 2, 0.0)
@example(np.pi / 2, 0.0, 0.3)
def test_roll_pitch_and_yaw_turn_as_the_matrix_does(roll, pitch, yaw):
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])

    def matrix(cr, sr, cp, sp, cy, sy):
        return (
            np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
            @ np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
            @ np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        )

    R = matrix(cr, sr, cp, sp, cy, sy)
    again = [f(angle) for angle in _rpy(R) for f in (np.cos, np.sin)]
    # Next to straight up the arc sine and the limit of 1e-9 leave 1e-4.
    np.testing.assert_allclose(matrix(*again), R, atol=1e-7 if abs(sp) < 0.999 else 2e-4)


@pytest.mark.parametrize("yaw", [0.7, -2.0])
def test_straight_up_the_whole_turn_is_yaw(yaw):
    c, s = np.cos(yaw), np.sin(yaw)
    assert _rpy(np.array([[0.0, -s, c], [0.0, c, s], [-1.0, 0.0, 0.0]])) == pytest.approx((0.0, np.pi / 2, yaw))


def test_geoms_of_hidden_groups_are_not_drawn_unless_there_are_no_others():
    nose = '<geom name="nose"'
    hidden = shape_of(Airframe(model=changed((nose, '<geom name="nose" group="3"'))))
    assert len(hidden) == len(shape_of(Airframe(model=TEXT))) - 1
    every = changed(('<geom contype="0"', '<geom group="3" contype="0"'))
    assert shape_of(Airframe(model=every)) == shape_of(Airframe(model=TEXT))


def test_an_airframe_without_damping_hovers_in_its_trials():
    """They begin at rest: what nothing stops would go on."""
    Airframe(model=changed(('biasprm="0 0 -0.0004"', 'biasprm="0 0 0"'), (' viscosity="0.02"', ""))).start(UP)


def test_a_text_has_at_most_the_length_of_its_own_and_of_its_meshes():
    most = MAX_TEXT_BYTES + 2 * MAX_MESH_BYTES
    with pytest.raises(ValueError, match=f"has {most + 1:,} characters: at most {most:,} are allowed"):
        Airframe(model="<" + most * " ").start(UP)


def test_check_says_what_is_kept_and_what_is_not(tmp_path, capsys):
    assert main(["check", str(QUADROTOR)]) == 0
    assert "kept    It keeps the contract of an airframe." in capsys.readouterr().out
    (tmp_path / "bad.xml").write_text(changed(("<freejoint/>", "")))
    assert main(["check", str(tmp_path / "bad.xml")]) == 1
    out = capsys.readouterr().out
    assert "broken  It keeps the contract of an airframe." in out
    assert "fuselage has no free joint" in out
    assert main(["check", str(tmp_path / "none.xml")]) == 2
