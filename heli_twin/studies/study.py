"""A study as a value: base experiment, axes, alternatives and design. Read from TOML or made in Python."""

import tomllib
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Gt, Le, MinLen, doc

from controllers.markers import OneOf
from controllers.programs import beside
from heli_twin.experiment.families import DESIGNS, HELI_TWIN, all_members, members
from heli_twin.experiment.help_text import explained
from heli_twin.experiment.named_classes import is_reference, own_member_in
from heli_twin.experiment.named_files import with_content, with_members
from heli_twin.experiment.own import OWN, mark_of, with_commands
from heli_twin.experiment.text import assignment
from heli_twin.experiment.toml_file import part_in
from heli_twin.experiment.tree import ExperimentError, Tree, spec_of
from heli_twin.requirements import Requirement, requirements_of, table_of
from heli_twin.studies.designs import Batches, Design
from heli_twin.studies.designs.grid import Grid
from heli_twin.studies.ensemble import embedded
from heli_twin.studies.errors import StudyError
from heli_twin.studies.plain import MAX_NAME_LENGTH, check_plain
from heli_twin.studies.sequential import MOST
from heli_twin.studies.space import Space
from heli_twin.terminal_text import clean, instead
from heli_twin.tuning.record import uncommented


@explained
@dataclass(frozen=True, slots=True)
class Logs:
    """The numbers of flights whose MCAP logs are kept."""

    failed: Annotated[int, Ge(0), doc("of the first so many that failed")] = 50
    worst: Annotated[int, Ge(0), doc("of so many that completed with the worst score")] = 5
    sampled: Annotated[int, Ge(0), doc("of so many, evenly spread over the study")] = 3


@explained
@dataclass(frozen=True, slots=True)
class Study:
    """A question, and the flights that answer it."""

    name: Annotated[str, MinLen(1), doc("of the folder with the results")] = "study"
    question: Annotated[str, doc("what it answers, one sentence")] = ""
    base: Annotated[Tree, doc("the experiment that is varied; `preset` names what it starts from")] = field(
        default_factory=dict
    )
    alternatives: Annotated[Tree, doc("what is compared: a name, and the changes it stands for")] = field(
        default_factory=dict
    )
    axes: Annotated[Tree, doc("what is swept: a dotted path, and its values")] = field(default_factory=dict)
    design: Annotated[Design, OneOf("heli_twin.studies.designs"), doc("which points of the axes are flown")] = field(
        default_factory=Grid
    )
    replicates: Annotated[
        int,
        Ge(1),
        Le(100_000),
        doc('flights a point, with the same seeds at all points; "auto": by half_width'),
    ] = 1
    half_width: Annotated[
        float, Ge(0), doc("fly no more seeds than give each mean score a 95 % interval of +- this; 0: all of them")
    ] = 0.0
    seed: Annotated[int, Ge(0), Le(2**52), doc("the first of the shared seeds; sampling designs draw from it too")] = 0
    score: Annotated[str, doc("the metric that ranks flights, smaller is better")] = "rmse.position"
    metrics: Annotated[tuple[str, ...], doc("metrics to compare in the report")] = (
        "rmse.position",
        "rmse.x",
        "rmse.y",
        "rmse.z",
        "rmse.yaw",
        "max_abs_error.position",
    )
    margins: Annotated[bool, doc("measure the stability margins of each alternative, a hover of 51 s each")] = False
    tuning: Annotated[
        tuple[Tree, ...], doc("records of how controllers were tuned, as `heli-twin tune --save` leaves them")
    ] = ()
    requirements: Annotated[
        Tree,
        doc(
            "what each flight must do: formulas by name, or the name of a file of them; one that breaks some has"
            " failed, and `excess.NAME` is the share of its limit by which it does"
        ),
    ] = field(default_factory=dict)
    penalty: Annotated[float, Gt(0), doc("the score of a flight that failed")] = 2.5
    logs: Annotated[Logs, doc("which flights leave their MCAP behind")] = field(default_factory=Logs)
    timeout: Annotated[
        float, Ge(0), doc("s: a flight that takes longer has hung; 0: 60 s and 5 times its duration")
    ] = 0.0
    max_runs: Annotated[int, Ge(1), doc("a study with more flights than this is a mistake")] = 100_000

    @property
    def seeds(self) -> range:
        """The seeds that every point is flown with: common random numbers."""
        return range(self.seed, self.seed + self.replicates)

    @property
    def required(self) -> tuple[Requirement, ...]:
        """The requirements, read.

        Raises:
            RequirementError: Names the requirement and the place in its formula.
        """
        return requirements_of(self.requirements) if self.requirements else ()


def shipped() -> dict[str, Path]:
    """The studies that come with heli_twin, by name."""
    folder = Path(str(files("heli_twin.studies") / "library"))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def load_study(source: str, overrides: Iterable[str] = ()) -> Study:
    """Read a study and change it.

    Args:
        source: Name of a shipped study, or path of a TOML file.
        overrides: Changes, each `field=value`: a field of the study, or a dotted path of its base experiment.

    Returns:
        The study. A part that it names by a file, `controller = "pid.toml"`, is read, and its tuning's record with it.

    Raises:
        HeliTwinError: One sentence that says what is wrong and what would be right.
    """
    known = shipped()
    path = known.get(source, Path(source))
    if source not in known and path.suffix != ".toml":
        raise StudyError(f"unknown study {instead(source, known)}; a file of your own ends in .toml")
    tree = _parsed(path, _text(path))
    tree.setdefault("name", path.stem)
    check_plain(tree)
    tree = _complete(tree, path.parent)
    for text in overrides:
        _override(tree, text)
        tree = _complete(tree, Path())
    return study_of(tree)


def _complete(tree: Tree, folder: Path) -> Tree:
    """Return a study's tables with what they name by files of a folder: parts, contents, classes of the user's own."""
    _read_parts(tree)
    _read_contents(tree, folder)
    if isinstance(named := tree.get("requirements"), str):
        tree["requirements"] = table_of(requirements_of(folder / named if named.endswith(".toml") else named))
    return _with_members(tree, folder)


def _with_members(tree: Tree, folder: Path) -> Tree:
    """Return a study's tables with the classes and ensembles that they name by files or import paths."""
    tree = dict(tree)
    for name in ("base", "axes"):
        if isinstance(changes := tree.get(name), dict):
            tree[name] = with_members("", changes, folder)
    if isinstance(axes := tree.get("axes"), dict):
        tree["axes"] = embedded(axes, folder)
    if isinstance(alternatives := tree.get("alternatives"), dict):
        tree["alternatives"] = {name: with_members("", changes, folder) for name, changes in alternatives.items()}
    design = tree.get("design")
    kind = design.get("kind") if isinstance(design, dict) else design
    if isinstance(kind, str) and is_reference(kind):
        kind = own_member_in(folder, DESIGNS, kind)
        tree["design"] = {**(design if isinstance(design, dict) else {}), "kind": kind}
    return tree


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise StudyError(f"cannot read {clean(path, 200)}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise StudyError(f"cannot read {clean(path, 200)}: it is not UTF-8 text") from None
    except ValueError:
        raise StudyError(f"cannot read {clean(path, 200)}: it is no file name") from None


def _parsed(path: Path, text: str) -> Tree:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise StudyError(f"{path} is not valid TOML: {error}") from None
    except ValueError:
        raise StudyError(f"{path} is not valid TOML: it holds a whole number with too many digits") from None
    except RecursionError:
        raise StudyError(f"{path} is not valid TOML: its brackets are nested too deeply") from None


def _read_parts(tree: Tree) -> None:
    """Put the parts in place that are named by files: `controller = "pid.toml"`, as on the command line."""
    alternatives = tree.get("alternatives")
    places = [tree.get("base"), *(alternatives.values() if isinstance(alternatives, dict) else ())]
    for changes in [place for place in places if isinstance(place, dict)]:
        for part, path in _files(changes).items():
            changes[part], records = _part(path, part)
            if isinstance(tree.setdefault("tuning", []), list):
                tree["tuning"] = [*tree["tuning"], *records]


def _read_contents(tree: Tree, folder: Path) -> None:
    """Put the contents of files in place of their names, where a field of an experiment holds one.

    The files of a program's command are named from the folder on.
    """
    for name in tree.keys() & {"base", "axes", "alternatives", "design"}:
        tree[name] = with_commands(tree[name], partial(beside, folder), name)
    for name in ("base", "axes"):
        if isinstance(changes := tree.get(name), dict):
            tree[name] = with_content("", changes, folder)
    if isinstance(alternatives := tree.get("alternatives"), dict):
        tree["alternatives"] = {name: with_content("", changes, folder) for name, changes in alternatives.items()}


def _files(changes: Tree) -> dict[str, Path]:
    named = {part: Path(v) for part, v in changes.items() if isinstance(v, str) and v.endswith(".toml")}
    # A preset is read where the base begins.
    named.pop("preset", None)
    return named


def _part(path: Path, part: str) -> tuple[Tree, list[Tree]]:
    """A part of an experiment in a file, and the record of its tuning if it has one."""
    table = part_in(str(path), part)
    record = _parsed(path, uncommented(_text(path)))
    return table, [record] if record else []


def study_of(tree: Tree) -> Study:
    """A study from nested tables, as a TOML file holds them; files that they name are those of the current folder.

    Raises:
        ExperimentError: Names the field, its value and what it may be.
    """
    check_plain(tree)
    return _study(_with_members(tree, Path()))


def with_own_members(study: Study) -> Study:
    """Return a study with the kinds of the classes that it names by files or import paths."""
    tables = {"base": study.base, "axes": study.axes, "alternatives": study.alternatives}
    return replace(study, **_with_members(tables, Path()))


def stored_study(tree: Tree) -> Study:
    """The study of a store, which is foreign: no file that it names is read, and no class of a user's own is needed.

    Raises:
        ExperimentError: Names the field, its value and what it may be.
    """
    check_plain(tree)
    design = tree.get("design")
    if isinstance(design, dict) and OWN in design:
        return replace(_study({**tree, "design": {"kind": "grid"}}), design=FlownDesign())
    return _study(tree)


@dataclass(frozen=True, slots=True)
class FlownDesign:
    """A stand-in for a design of a user's own when its flights are looked at: it plans nothing more."""

    adaptive: ClassVar[bool] = False
    kind: Literal["flown"] = "flown"

    def check(self, space: Space) -> None:
        """Refuse to plan.

        Raises:
            StudyError: Always.
        """
        raise StudyError("the design of this study is a class of its user's own: name the study's file to fly it again")

    def count(self, space: Space) -> int:
        """No runs."""
        return 0

    def batches(self, space: Space) -> Batches:
        """Yield nothing."""
        yield from ()


def _study(tree: Tree) -> Study:
    tree = dict(tree)
    if tree.get("replicates") == "auto":
        if not tree.get("half_width"):
            raise StudyError('replicates = "auto" needs half_width: how well each mean score is to be known, +-')
        tree["replicates"] = MOST
    design = tree.get("design")
    if isinstance(design, str):
        tree["design"] = {"kind": design}
    elif isinstance(design, dict) and "kind" not in design:
        raise ExperimentError(f"design.kind is missing. Available: {', '.join(members(DESIGNS))}")
    study = spec_of(Study, tree)
    if any(not isinstance(record.get("controller"), dict) for record in study.tuning):
        raise StudyError("a record of [[tuning]] needs `controller`: the table that the tuning found")
    if len(study.name) > MAX_NAME_LENGTH:
        raise StudyError(f"name has {len(study.name)} characters, and it names a folder: at most {MAX_NAME_LENGTH}")
    if set(study.name) & set('/\\:*?"<>|\0') or study.name in (".", ".."):
        raise StudyError(f"name = '{study.name}': it names a folder, so write letters, digits, - and _")
    return study


def study_tree(study: Study) -> Tree:
    """A study as nested tables of plain values; a design of the user's own is marked with the hash of its source."""
    tree, design = asdict(study), type(study.design)
    if not any(member.spec is design and member.origin == HELI_TWIN for member in all_members(DESIGNS).values()):
        tree["design"][OWN] = mark_of(design)
    return tree


def _override(tree: Tree, text: str) -> None:
    """Change a study's tables as `field=value` says."""
    path, value = assignment(text, "field=value, such as replicates=5 or duration=10")
    check_plain({"it": value})
    first, *rest = path.split(".")
    if first not in {f.name for f in fields(Study)}:
        first, rest = "base", [first, *rest]
    if first in ("axes", "alternatives") and rest and isinstance(tree.setdefault(first, {}), dict):
        tree[first][".".join(rest)] = value
    else:
        _set(tree, [first, *rest], value)


def _set(tree: Tree, keys: list[str], value: Any) -> None:
    """Set a value in nested tables; `part = "kind"` is short for a table, and another kind starts afresh."""
    for key in keys[:-1]:
        inner = tree.get(key, {})
        tree[key] = dict(inner) if isinstance(inner, dict) else {"kind": inner}
        tree = tree[key]
    if keys[-1] == "kind" and tree.get("kind") != value:
        tree.clear()
    tree[keys[-1]] = value
