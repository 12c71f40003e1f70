import sys
from dataclasses import dataclass, fields
from importlib import import_module
from pkgutil import iter_modules
from typing import Annotated, Literal

import pytest
from annotated_types import Gt

from heli_twin.experiment import Experiment, values
from heli_twin.experiment.families import GROUPS, _ours, kind_of, members, specs_in
from heli_twin.experiment.fields import fields_of

PACKAGES = sorted(part.family.package for part in fields_of(Experiment).values() if part.family)


@pytest.mark.parametrize("package", PACKAGES)
def test_every_member_is_a_frozen_value_that_names_itself(package):
    family = members(package)
    assert family
    for kind, spec in family.items():
        member = spec()
        assert member.kind == kind
        assert member == spec()
        assert hash(member) == hash(spec())
        assert spec.__dataclass_params__.frozen
        # `kind` comes first, so that a table says what it is before it says how.
        assert fields(spec)[0].name == "kind"
        assert spec.__doc__


def parts_of(spec):
    """The class and those of its parts that are tables of fields."""
    yield spec
    for info in fields_of(spec).values():
        if not info.is_plain and info.family is None:
            yield from parts_of(info.type)


@pytest.mark.parametrize("package", ["", *PACKAGES])
def test_what_our_classes_have_as_a_default_need_not_be_checked(package, monkeypatch):
    monkeypatch.setattr(values, "_is_default", lambda value, name, spec: False)
    for spec in [Experiment] if not package else members(package).values():
        for part in parts_of(spec):
            for name, default in values._defaults(part).items():
                info = fields_of(part)[name]
                assert info.is_plain
                assert repr(values.checked_value(info, default, name, part)) == repr(default)


@dataclass(frozen=True)
class Slow:
    kind: Literal["slow"] = "slow"
    speed: Annotated[float, Gt(0)] = 0.0


def test_what_a_user_s_class_has_as_a_default_is_checked():
    with pytest.raises(values.ExperimentError, match=r"speed = 0\.0: it must be greater than 0"):
        values.checked_value(fields_of(Slow)["speed"], 0.0, "speed", Slow)


@pytest.mark.parametrize("package", PACKAGES)
def test_members_are_in_alphabetical_order(package):
    assert list(members(package)) == sorted(members(package))


def test_the_families_hold_what_the_paper_needs():
    assert {"circle", "hover"} <= set(members("controllers.trajectories"))
    assert "ltv_mpc" in members("controllers.laws")
    assert set(members("heli_twin.lab.plant")) >= {"ideal", "mujoco"}


MEMBER = '''
from dataclasses import dataclass, field
from typing import Literal

@dataclass(frozen=True)
class {name}:
    """One."""
    kind: Literal["{kind}"] = "{kind}"
    size: float = 1.0

@dataclass(frozen=True)
class Helper:
    """Without a kind it is no member."""
    size: float = 1.0
'''


def test_a_new_file_is_a_new_member(tmp_path, monkeypatch):
    home = tmp_path / "some_family"
    home.mkdir()
    (home / "__init__.py").write_text('"""A family."""\n')
    (home / "zebra.py").write_text(MEMBER.format(name="Zebra", kind="zebra"))
    (home / "ape.py").write_text(MEMBER.format(name="Ape", kind="ape") + "from some_family.zebra import Zebra\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    try:
        family = members("some_family")
        assert [spec.__name__ for spec in family.values()] == ["Ape", "Zebra"]
        assert list(family) == ["ape", "zebra"]
    finally:
        for name in [n for n in sys.modules if n.partition(".")[0] == "some_family"]:
            del sys.modules[name]


@pytest.mark.parametrize("package", [*GROUPS, *(p for p in PACKAGES if p not in GROUPS)])
def test_the_text_of_our_files_tells_their_members(package):
    """A member is then loaded when it is asked for, and no other with it."""
    home = import_module(package)
    files = [f"{package}.{room.name}" for room in iter_modules(getattr(home, "__path__", []))]
    loaded = [kind_of(spec) for module in (home, *map(import_module, files)) for spec in specs_in(module)]
    assert sorted(loaded) == list(members(package))


def test_a_module_can_be_a_family():
    family = members("heli_twin.lab.compute")
    assert set(family) == {"modelled", "off"}


@dataclass(frozen=True)
class Elsewhere:
    kind: str = "elsewhere"


def test_what_is_only_imported_is_no_member(monkeypatch):
    monkeypatch.setattr("heli_twin.lab.compute.Elsewhere", Elsewhere, raising=False)
    _ours.cache_clear()
    try:
        assert "elsewhere" not in _ours("heli_twin.lab.compute")
    finally:
        _ours.cache_clear()
