"""Scales of axes: every field that a study can sweep has one, whichever member of a family has it."""

import pytest
from experiment.test_text import MEMBERS, leaves

from heli_twin import load
from heli_twin.reporting.words import Scale, field


@pytest.mark.parametrize("member", MEMBERS, ids=lambda member: "=".join(member))
def test_every_field_of_every_member_has_a_scale(member: tuple[str, str]) -> None:
    for path, _ in leaves(load("lab", ["=".join(member)])):
        assert field(path).name == path


def test_scales_have_units_that_a_person_reads() -> None:
    assert field("plant.mass", [0.02, 0.03]) == Scale("plant.mass", "g", 1e3)
    assert field("radio.latency", [0.0, 0.04]) == Scale("radio.latency", "ms", 1e3)
    assert field("duration", [10.0, 30.0]) == Scale("duration", "s", 1.0)
    # The model of the paper's plant is a table, that of an airframe a text.
    assert field("plant.model.k_x") == field("controller.model.k_x")._replace(name="plant.model.k_x")
    assert field("plant.model.k_x").unit == "1/s"
    assert field("no.such.field") == Scale("no.such.field", "", 1.0)
