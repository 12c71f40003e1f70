"""Reads an experiment from a preset or a TOML file and applies overrides, `path.to.field=value`.

`part = "kind"` is short for a table with that `kind`: the member of the family, with its default values. There can be
several disturbances and faults: `"on"` adds the one of that kind with its default values, `"off"` removes it, and
`disturbances.second = "gust"` adds another gust under the name `second`.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from controllers.detailed_model import DetailedModel
from heli_twin.experiment import Experiment
from heli_twin.experiment.fields import fields_of
from heli_twin.experiment.named_files import is_content, with_content, with_members
from heli_twin.experiment.past import Tree, restore_past
from heli_twin.experiment.paths import leaves_of, put, put_part
from heli_twin.experiment.places import content_field_at, family_at
from heli_twin.experiment.toml_file import NOT_TOML, part_in, presets, read_file, toml_table
from heli_twin.experiment.tree import experiment_of, tree_of
from heli_twin.experiment.values import DEEPEST, ExperimentError
from heli_twin.terminal_text import clean


def load(source: str | None = None, overrides: Iterable[str] = ()) -> Experiment:
    """Read an experiment from a preset or a TOML file and change it.

    Args:
        source: Name of a preset or path of a TOML file; None for `lab`.
        overrides: Changes, each `path.to.field=value`; changes of a `kind` are applied before the others.

    Returns:
        The experiment. Fields that the file leaves out have their default values; if the file names an older physics
        version, they have the values of that version.

    Raises:
        ExperimentError: The source or an override is wrong; the message names the nearest valid choice.
    """
    tree = tree_of(Experiment())
    file = read_file(source or "lab")
    leaves = dict(leaves_of(file.tree))
    for path, value in leaves.items():
        if not (file.is_calibration and _is_of_another_law(tree, path)):
            put(tree, path, value)
    restore_past(Experiment, tree, file.version, leaves)
    is_own = source is not None and source not in presets()
    return _changed(tree, overrides, {path: v for path, v in leaves.items() if is_own and path.startswith(_BELIEFS)})


def changed(experiment: Experiment, overrides: Iterable[str]) -> Experiment:
    """Return an experiment with some fields changed.

    Args:
        experiment: It stays as it is.
        overrides: Changes, each `path.to.field=value`; changes of a `kind` are applied before the others.

    Raises:
        ExperimentError: An override is wrong; the message names the nearest valid choice.
    """
    return _changed(tree_of(experiment), overrides)


_BELIEFS = ("controller.model.", "estimator.command_delay", "estimator.gust_time")
"""Begins of the paths of what a file may say of the helicopter as any law or estimator believes it."""


def _changed(tree: Tree, overrides: Iterable[str], believed: Mapping[str, Any] | None = None) -> Experiment:
    """Apply overrides; a law or an estimator that is selected by its kind alone believes what is `believed`."""
    for path, value in sorted(map(override_of, overrides), key=lambda change: not names_a_kind(*change)):
        put_part(tree, path, value)
        part = path.removesuffix(".kind")
        if not isinstance(value, str) or part not in ("controller", "estimator"):
            continue
        for belief, its in (believed or {}).items():
            if belief.startswith(f"{part}.") and not _is_of_another_law(tree, belief):
                put(tree, belief, its)
    return experiment_of(tree)


def _is_of_another_law(tree: Tree, path: str) -> bool:
    """Return whether a path is of a belief that the law or estimator of a tree has no place for, but others have.

    A calibration says what any law may believe of its helicopter, and each takes what its model has.
    """
    *tables, name = path.split(".")
    known: dict[tuple[str, ...], Iterable[str]] = {
        ("controller", "model"): fields_of(DetailedModel),
        ("estimator",): ("command_delay", "gust_time"),
    }
    here: Any = tree
    for table in tables:
        here = here.get(table, {}) if isinstance(here, dict) else {}
    return name in known.get(tuple(tables), ()) and name not in here


def names_a_kind(path: str, value: Any) -> bool:
    """Return whether a change selects the member of a family at its path."""
    is_member = isinstance(value, str | dict) and value not in ("on", "off") and bool(family_at(path))
    return path.endswith(".kind") or is_member or (is_content(value) and content_field_at(path) is not None)


def override_of(text: str) -> tuple[str, Any]:
    """Parse an override, also `part=FILE.toml`; return its path and its value."""
    path, value = assignment(text)
    value = with_content(path, with_members(path, value, Path()), Path())
    return path, part_in(value, path) if isinstance(value, str) and value.endswith(".toml") else value


def assignment(text: str, example: str = "path.to.field=value, such as plant.mass=0.03") -> tuple[str, Any]:
    """Parse an override, `path.to.field=value`.

    Args:
        text: The override.
        example: A valid override, for the error message.

    Returns:
        The dotted path, and the value: read as TOML, or the text itself if it is not valid TOML, so that names need no
        quotes.

    Raises:
        ExperimentError: There is no `=`, there is nothing before it, or the path has too many levels.
    """
    path, equals, value = (word.strip() for word in text.partition("="))
    if not equals or not path:
        raise ExperimentError(f"'{clean(text, 80)}' is not an override: write {example}")
    if path.count(".") >= DEEPEST:
        raise ExperimentError(f"'{clean(path, 80)}' is nested deeper than {DEEPEST} levels")
    try:
        return path, toml_table(f"v = {value}")["v"]
    except NOT_TOML:
        return path, value
