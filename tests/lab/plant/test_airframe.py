"""A helicopter of a user's own: an MJCF that keeps the contract flies here, any other is refused in one sentence."""

import json
import random
from copy import deepcopy
from dataclasses import replace
from math import sqrt
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from controllers.model import GRAVITY, Model
from heli_twin import Experiment, HeliTwinError, fly, load, read_log
from heli_twin.cli import main
from heli_twin.experiment.tree import canonical_json, from_json, toml_of
from heli_twin.lab.plant import STILL_AIR, Air, contract, physical_state
from heli_twin.lab.plant.airframe import Airframe, _rpy, shape_of
from heli_twin.lab.plant.contract import violations
from heli_twin.lab.plant.mjcf_text import MAX_MESH_BYTES, MAX_TEXT_BYTES, read_text, timestep
from heli_twin.lab.plant.mujoco import MuJoCo, engine, model_file
from heli_twin.lab.plant.shape import Primitive

FOLDER = Path(__file__).parent / "airframes"
QUADROTOR = FOLDER / "quadrotor.xml"
TEXT = QUADROTOR.read_text()
# Torque, thrust, mass and inertia of the file: sin(tilt) = 0.0049 / (0.32 * 0.05) at full stick.
B_X, B_Z, B_YAW = GRAVITY * 0.0049 / 0.016, 1.2 / 0.060, 0.0021 / 7e-5
BELIEVED = Model(b_x=B_X, k_x=-0.2, b_y=B_X, k_y=-0.2, b_z=B_Z, b_yaw=B_YAW, k_yaw=-5.9)
UP = np.array([0.2, -0.1, 50.0, 0.6, 0.0, 0.0, 0.0, 0.0])
SECOND = 1_000_000_000


def changed(*pairs: tuple[str, str]) -> str:
    """The quadrotor with pieces of its text replaced."""
    text = TEXT
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return text


def held(u, seconds, spec=None, x=UP, air=STILL_AIR):
    """The truth after holding the trim plus `u`."""
    spec = spec or Airframe(model=TEXT)
    plant = spec.start(x)
    plant.advance(round(seconds * SECOND), plant.truth().actuators + u, air)
    return plant.truth()


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


# --- meshes ---------------------------------------------------------------------------------------------------------

BRICK = "".join(f"v {x} {y} {z}\n" for x in (0, 0.02) for y in (0, 0.03) for z in (0, 0.04))
BRICK += "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
TETRAHEDRON = "v 0 0 0\nv 0.02 0 0\nv 0 0.02 0\nv 0 0 0.02\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
WITH_MESH = (
    ("<asset>", '<asset><mesh name="hull" file="hull.obj"/><texture name="t" file="x.png" type="2d"/>'),
    ('<geom name="nose" type="sphere" size="0.007"', '<geom name="nose" type="mesh" mesh="hull"'),
    ('angle="radian"', 'angle="radian" meshdir="meshes"'),
)


def test_mesh_files_become_a_part_of_the_text(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "hull.obj").write_text(TETRAHEDRON)
    (tmp_path / "quad.xml").write_text(changed(*WITH_MESH))
    experiment = load("lab", [f"plant.model={tmp_path / 'quad.xml'}", "duration=0.5"])
    (tmp_path / "meshes" / "hull.obj").unlink()
    again = from_json(canonical_json(experiment))
    assert fly(again, log_dir=None).outcome.kind == "completed"
    nose = next(part for part in again.plant.shape() if part.kind == "box" and part.size[0] < 0.03)
    assert nose.size == pytest.approx((0.02, 0.02, 0.02), abs=0.015)


def test_a_mesh_is_drawn_as_the_box_around_it(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "hull.obj").write_text(BRICK)
    (tmp_path / "quad.xml").write_text(changed(*WITH_MESH))
    (deck, nose) = (part for part in Airframe(model=tmp_path / "quad.xml").shape() if part.kind == "box")
    assert deck.size == pytest.approx((0.056, 0.040, 0.016))
    # The engine turns a mesh to its principal axes, the longest first or last.
    assert sorted(nose.size) == pytest.approx([0.02, 0.03, 0.04])
    # From the place of the nose, 0.033 0 0.002, half a brick further.
    assert nose.centre == pytest.approx((0.033 + 0.01, 0.015, 0.002 + 0.02), abs=1e-9)


def test_a_packed_mesh_is_whole_base64():
    packed = '<custom><text name="file:a.stl" data="{}"/></custom><worldbody>'
    Airframe(model=changed(("<worldbody>", packed.format("QUJD"))))
    for data in ("QUJ", "QU!JD", "é"):
        with pytest.raises(ValueError, match=r"holds the mesh file 'a\.stl' in no base64"):
            Airframe(model=changed(("<worldbody>", packed.format(data))))


def test_mesh_files_are_bounded(tmp_path):
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "hull.obj").write_text(TETRAHEDRON + "#" * MAX_MESH_BYTES)
    (tmp_path / "quad.xml").write_text(changed(*WITH_MESH))
    with pytest.raises(HeliTwinError, match=r"hull\.obj has more than the 1,048,576 bytes"):
        load("lab", [f"plant.model={tmp_path / 'quad.xml'}"])

    (tmp_path / "meshes" / "hull.obj").write_text(TETRAHEDRON + "#" * (MAX_MESH_BYTES // 2))
    (tmp_path / "meshes" / "more.obj").write_text(TETRAHEDRON + "#" * (MAX_MESH_BYTES // 2))
    two = changed(*WITH_MESH).replace("<asset>", '<asset><mesh file="more.obj"/>')
    (tmp_path / "quad.xml").write_text(two)
    with pytest.raises(HeliTwinError, match=r"mesh files of more than 1,048,576 bytes"):
        load("lab", [f"plant.model={tmp_path / 'quad.xml'}"])


def test_a_link_out_of_the_folder_is_not_followed(tmp_path):
    (tmp_path / "mine" / "meshes").mkdir(parents=True)
    (tmp_path / "hull.obj").write_text(TETRAHEDRON)
    (tmp_path / "mine" / "meshes" / "hull.obj").symlink_to(tmp_path / "hull.obj")
    (tmp_path / "mine" / "quad.xml").write_text(changed(*WITH_MESH))
    with pytest.raises(HeliTwinError, match="a link out of the folder"):
        load("lab", [f"plant.model={tmp_path / 'mine' / 'quad.xml'}"])


# --- what is refused ------------------------------------------------------------------------------------------------

MESH = '<asset><mesh name="m" file="{}"/>'
REFUSALS = {
    "empty": ("", "is no MJCF"),
    "another root": ("<robot/>", "its root is <robot>"),
    "not closed": ("<mujoco>", "is not XML"),
    "entities": ('<!DOCTYPE m [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><mujoco model="&b;"/>', "a document type"),
    "too deep beside many": (
        "<mujoco>" + "<body/>" * 50 + "<body>" * 50 + "</body>" * 50 + "</mujoco>",
        "deeper than 40",
    ),
    "too deep": ("<mujoco>" + "<body>" * 5000 + "</body>" * 5000 + "</mujoco>", "deeper than 40"),
    "too many": ("<mujoco>" + "<body/>" * 6000 + "</mujoco>", "more than 5000 elements"),
    "too large": ("<mujoco>" + " " * MAX_TEXT_BYTES + "</mujoco>", "more than the 262,144 bytes"),
    "include": (("<worldbody>", '<include file="/etc/passwd"/><worldbody>'), "<include>: put its text"),
    "plugin": (("<worldbody>", '<extension><plugin plugin="a"/></extension><worldbody>'), "loads no code"),
    "replicate": (('<site name="world"/>', '<replicate count="1000000"><body/></replicate>'), "<replicate>"),
    "composite": (('<site name="world"/>', '<composite count="1000 1000 1000"/>'), "<composite>"),
    "height field": (("<asset>", '<asset><hfield name="h" nrow="100000" ncol="100000"/>'), "<hfield>"),
    "sphere of 4^10": (("<asset>", '<asset><mesh name="h" builtin="sphere" params="10"/>'), "<mesh builtin"),
    "iterations": (("<option ", '<option iterations="1000000000" '), "at most 200"),
    "absolute path": (("<asset>", MESH.format("/etc/passwd.stl")), "in the folder of the MJCF"),
    "parent": (("<asset>", MESH.format("a/../../x.stl")), "in the folder of the MJCF"),
    "URL": (("<asset>", MESH.format("https://example.org/x.stl")), "in the folder of the MJCF"),
    "another file": (("<asset>", MESH.format("id_rsa")), "ends in .stl, .obj or .msh"),
    "no such mesh": (("<asset>", MESH.format("a.stl")), "a.stl: there is no such file"),
    "file of a geom": (('<geom name="deck" ', '<geom name="deck" file="x" '), "reads mesh files and nothing else"),
    "delay": (('name="u_x" ', 'name="u_x" delay="0.01" nsample="10" '), "plant.input_delay"),
    "long step": (('timestep="0.001"', 'timestep="0.1"'), "a timestep of 0.1 s"),
    "no step": (('timestep="0.001"', 'timestep="nan"'), "a timestep of nan s"),
    "no body": (('name="fuselage"', 'name="drone"'), "the body fuselage is missing (there are drone)"),
    "no joint": (("<freejoint/>", ""), "no free joint"),
    "ball joint": (("<freejoint/>", '<joint type="ball"/>'), "no free joint"),
    "no mass": (('mass="0.060"', 'mass="0"'), "mass and inertia of moving bodies"),
    "no stick": (('name="u_yaw"', 'name="yaw"'), "the actuator u_yaw is missing (there are u_x"),
    "stick range": (('ctrlrange="0 1"', 'ctrlrange="0 2"'), "the ctrlrange of u_z is not 0 1"),
    "order": (("<actuator>", '<actuator><general name="a" site="cog"/>'), "the first four actuators are a, u_x"),
    "dynamics": (('name="u_x" ', 'name="u_x" dyntype="integrator" '), "the dyntype of u_x"),
    "no key frame": (('name="hover"', 'name="start"'), "the key frame hover is missing (there are start)"),
    "no hover": (("0 0 0.4905", "0 0 0.3"), "it moves at 1.8 m/s"),
    "beyond": (("0 0 0.4905", "0 0 1.4905"), "beyond the ctrlrange"),
    "wrong way": (('gear="0 0 0 -1 0 0"', 'gear="0 0 0 1 0 0"'), "u_y has to move it to port, and acts the other way"),
    "no effect": (('gear="0 0 0 0 1 0" gain', 'gear="0 0 0 0 0 0" gain'), "u_x has to move it forwards, and does"),
    "syntax": (("<freejoint/>", '<freejoint flavour="sweet"/>'), "unrecognized attribute: 'flavour'"),
    "bodies": (("</worldbody>", "<body/>" * 101 + "</worldbody>"), "bodies, at most 100"),
    "escape": (("<asset>", MESH.format("&#x9b;31m.stl")), r"\x9b31m.stl"),
}


@pytest.mark.parametrize(
    ("count", "what", "most"), [("nbody", "bodies", 100), ("ngeom", "geoms", 500), ("nv", "degrees of freedom", 100)]
)
def test_a_model_has_at_most_so_many_parts(count, what, most, monkeypatch):
    many = SimpleNamespace(**dict.fromkeys(("nbody", "ngeom", "nv"), 0) | {count: most + 1})
    assert [*violations(None, many)] == [f"it has {most + 1} {what}, at most {most} are allowed"]
    model = Airframe(model=TEXT).drawn().compile()
    monkeypatch.setattr(contract, {"nv": "MAX_DEGREES"}.get(count) or f"MAX_{what.upper()}", getattr(model, count))
    assert not [*violations(engine(), model)]


@pytest.mark.parametrize("name", REFUSALS)
def test_it_is_refused_in_one_sentence(name, tmp_path, capsys):
    change, told = REFUSALS[name]
    file = tmp_path / "my_heli.xml"
    file.write_text(change if isinstance(change, str) else changed(change))
    assert main(["fly", f"plant.model={file}", "--log-dir", str(tmp_path / "logs")]) == 2
    out, error = capsys.readouterr()
    assert out == ""
    assert error.startswith("heli-twin: plant.model: ")
    assert told in error
    assert error.count("\n") == 1
    assert error.rstrip("\n").isprintable()
    assert len(error) < 500
    assert not (tmp_path / "logs").exists()


@pytest.mark.parametrize(
    ("change", "flies"),
    [
        # After half a second with 2 % too much thrust it rises by 0.1 m/s.
        (("0 0 0.4905", "0 0 0.5000"), True),
        (("0 0 0.4905", "0 0 0.5018"), False),
        (("0 0 0.4905", "0 0 0.4810"), True),
        (("0 0 0.4905", "0 0 0.4792"), False),
        # After half a second with 0.06 of yaw it turns at 0.3 rad/s.
        (("0.4905 0 0", "0.4905 0.059 0"), True),
        (("0.4905 0 0", "0.4905 0.063 0"), False),
    ],
)
def test_hovering_is_to_rise_by_less_than_ten_centimetres_and_to_turn_by_less_than_a_third(change, flies):
    if flies:
        assert Airframe(model=changed(change)).drawn() is not None
        return
    with pytest.raises(ValueError, match="instead of hovering"):
        Airframe(model=changed(change)).drawn()


@pytest.mark.parametrize(("gain", "acts"), [("2.1e-9", True), ("2.1e-12", False)])
def test_a_stick_that_acts_weakly_acts(gain, acts):
    # 2.1e-9 N m over 7e-5 kg m^2: at full stick 1.5e-5 rad/s after half a second.
    weak = Airframe(model=changed(('gainprm="0.0021"', f'gainprm="{gain}"')))
    if acts:
        assert weak.drawn() is not None
        return
    with pytest.raises(ValueError, match="a positive u_yaw has to move it nose to port, and does nothing"):
        weak.drawn()


@pytest.mark.parametrize(
    ("step", "told"), [("0.005", ""), ("0.00501", "a timestep"), ("1e-5", ""), ("9e-6", "a timestep")]
)
def test_a_physics_step_lasts_ten_microseconds_to_five_milliseconds(step, told):
    text = changed(('timestep="0.001"', f'timestep="{step}"'))
    if not told:
        assert Airframe(model=text).step == float(step)
        return
    with pytest.raises(ValueError, match=told):
        Airframe(model=text)


def test_the_limits_of_a_text_may_be_reached(tmp_path):
    most = MAX_TEXT_BYTES + 2 * MAX_MESH_BYTES
    assert timestep(f"<mujoco>{' ' * (most - 17)}</mujoco>") == 0.002
    assert timestep("<mujoco>" + "<body/>" * 4999 + "</mujoco>") == 0.002
    with pytest.raises(ValueError, match="more than 5000 elements"):
        timestep("<mujoco>" + "<body/>" * 5000 + "</mujoco>")
    (tmp_path / "hull.obj").write_text(TETRAHEDRON + "#" * (MAX_MESH_BYTES - len(TETRAHEDRON)))
    (tmp_path / "quad.xml").write_text(changed(("<asset>", MESH.format("hull.obj"))))
    assert len(read_text(tmp_path / "quad.xml")) > MAX_MESH_BYTES


def test_a_tree_may_be_forty_elements_deep():
    def deep(n: int) -> str:
        return '<mujoco><option timestep="0.004"/>' + "<body>" * (n - 1) + "</body>" * (n - 1) + "</mujoco>"

    assert timestep(deep(40)) == 0.004
    with pytest.raises(ValueError, match="deeper than 40"):
        timestep(deep(41))


def test_a_user_of_python_and_a_log_are_told_the_same(tmp_path):
    for change, told in (REFUSALS["include"], REFUSALS["iterations"], REFUSALS["URL"]):
        with pytest.raises(ValueError, match=r"^model ") as refusal:
            Airframe(model=changed(change))
        assert told in str(refusal.value) or "mesh file" in str(refusal.value)
    with pytest.raises(HeliTwinError, match=r"the flight cannot start: plant\.model does not keep the contract"):
        fly(Experiment(plant=Airframe(model=changed(("<freejoint/>", "")))), log_dir=None)
    for missing in (tmp_path / "none.xml", tmp_path):
        with pytest.raises(ValueError, match=r"^model: .*cannot (be )?read"):
            Airframe(model=missing)


def test_what_costs_memory_is_left_out(tmp_path):
    """Textures of 30 GB, an arena of 100 GB: neither changes a flight."""
    big = changed(
        ("<asset>", '<asset><texture name="t" type="2d" builtin="flat" width="100000" height="100000"/>'),
        ("<worldbody>", '<size memory="100G" nuser_body="1000000000"/><worldbody>'),
    )
    assert Airframe(model=big) == Airframe(model=TEXT)


def test_no_folder_stays_in_the_text():
    """Mesh files are in the text: a folder that one compiler names and another lacks makes no other helicopter."""
    compiler = TEXT[TEXT.index("<compiler ") : TEXT.index("/>", TEXT.index("<compiler ")) + 2]
    elsewhere = changed((compiler, compiler.replace("<compiler ", '<compiler meshdir="parts" texturedir="parts" ')))
    assert Airframe(model=elsewhere) == Airframe(model=TEXT)


STRANGE = ["0", "-1", "1e308", "nan", "inf", "", "a", "1 2 3 4 5 6 7 8 9", "true", "cog", "u_x", "\ud7ff", "mesh"]


def damaged(seed: int) -> str:
    """A model of ours with some attributes replaced, and elements left out or doubled."""
    chance = random.Random(seed)
    root = ET.fromstring(TEXT if seed % 2 else model_file().read_text())
    for _ in range(chance.choice([1, 1, 2, 4])):
        parent, child = chance.choice([(parent, child) for parent in root.iter() for child in parent])
        what = chance.random()
        if what < 0.7 and child.attrib:
            child.set(chance.choice(list(child.attrib)), chance.choice(STRANGE))
        elif what < 0.85:
            parent.remove(child)
        else:
            parent.append(deepcopy(child))
    return ET.tostring(root, encoding="unicode")


@pytest.mark.parametrize("first", [0, *(pytest.param(n, marks=pytest.mark.long) for n in range(40, 800, 40))])
def test_a_damaged_model_has_an_outcome_or_is_refused_in_one_sentence(first):
    for seed in range(first, first + 40):
        try:
            result = fly(Experiment(plant=Airframe(model=damaged(seed)), duration=0.2), log_dir=None)
        except (ValueError, HeliTwinError) as refusal:
            text = str(refusal)
            assert text.startswith(("model ", "the flight cannot start: ")), seed
            assert len(text) < 500, seed
            assert text.isprintable(), seed
        else:
            assert result.outcome.kind in ("completed", "crashed", "left_volume", "diverged", "landed"), seed


def test_a_stick_that_hovers_near_its_upper_limit_is_tried_downwards():
    # Up to the limit itself.
    for gain, hover in (("0.6", "0.981"), ("0.5886", "1.0")):
        truth = held(
            np.zeros(4), 0.1, Airframe(model=changed(('gainprm="1.2"', f'gainprm="{gain}"'), ("0.4905", hover)))
        )
        assert truth.position[2] == pytest.approx(UP[2], abs=1e-6)


def test_three_violations_are_told_and_the_others_counted(tmp_path):
    path = tmp_path / "wide.xml"
    path.write_text(changed(('ctrlrange="-1 1"', 'ctrlrange="-2 2"'), ('ctrlrange="0 1"', 'ctrlrange="0 2"')))
    with pytest.raises(HeliTwinError) as refused:
        load("lab", [f"plant.model={path}"])
    assert str(refused.value).count("the ctrlrange of") == 3
    assert "; and 1 more" in str(refused.value)
