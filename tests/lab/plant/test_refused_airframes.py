"""What of an MJCF is read, and what is refused in one sentence: meshes, limits, contract, damage."""

import random
from copy import deepcopy
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from quadrotor import TEXT, UP, changed, held

from heli_twin import Experiment, HeliTwinError, fly, load
from heli_twin.cli import main
from heli_twin.experiment.tree import canonical_json, from_json
from heli_twin.lab.plant import contract
from heli_twin.lab.plant.airframe import Airframe
from heli_twin.lab.plant.contract import violations
from heli_twin.lab.plant.mjcf_text import MAX_MESH_BYTES, MAX_TEXT_BYTES, read_text, timestep
from heli_twin.lab.plant.mujoco import engine, model_file

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
