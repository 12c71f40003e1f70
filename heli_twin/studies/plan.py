"""From a study to its runs: base, alternatives and axes are checked; each run is an experiment with a lasting id."""

import hashlib
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

from controllers.markers import OneOf
from controllers.programs import named
from heli_twin.experiment import Experiment
from heli_twin.experiment.differences import told
from heli_twin.experiment.envelope import Envelope, envelope_in, envelope_of
from heli_twin.experiment.fields import fields_of
from heli_twin.experiment.own import with_commands
from heli_twin.experiment.past import PHYSICS_VERSION
from heli_twin.experiment.several import Several
from heli_twin.experiment.several_text import load_several
from heli_twin.experiment.several_written import is_several_json, several_json
from heli_twin.experiment.text import load
from heli_twin.experiment.toml_file import is_several, presets
from heli_twin.experiment.tree import canonical_json
from heli_twin.metrics.reach import planned_reach
from heli_twin.studies.axes import Ensemble, Values, axis_of
from heli_twin.studies.columns import check_metrics
from heli_twin.studies.designs import Batches, Point
from heli_twin.studies.ensemble import check_apart, is_ensemble
from heli_twin.studies.errors import StudyError
from heli_twin.studies.sequential import until_known
from heli_twin.studies.space import Alternative, Space, experiments_of, text_of, value_at, varied, with_seed
from heli_twin.studies.study import Study, with_own_members
from heli_twin.terminal_text import clean

MAX_AXES = 100
HUGE_COUNT = 10**15
"""From here on a number of flights is not written out."""


class PlannedFlight(NamedTuple):
    """One flight that a study asks for."""

    id: str
    experiment: str
    """Canonical JSON."""
    coordinates: dict[str, Any]
    """Its place in the study: the first columns of its row."""
    changes: dict[str, Any]
    """Values by dotted path that turn the base into this experiment, without the seed; one object for all seeds."""
    keep: bool = False
    """True if its log is kept in any case."""


@dataclass(frozen=True)
class StudyPlan:
    """A study that has been checked."""

    study: Study
    space: Space
    contrast: str
    """The path of the experiment that the alternatives replace, such as `controller`; empty for named alternatives."""

    def count(self) -> int:
        """Return the greatest number of runs that it may need."""
        return self.study.design.count(self.space)

    @property
    def adaptive(self) -> bool:
        """True if the next batch depends on the rows of the last one."""
        return self.study.design.adaptive or self.study.half_width > 0.0

    def batches(self) -> Batches:
        """Yield the points to fly, batch by batch."""
        batches = self.study.design.batches(self.space)
        if not self.study.half_width:
            return batches
        return until_known((point for batch in batches for point in batch), self.space, self.study.half_width)

    @cached_property
    def words(self) -> frozenset[str]:
        """Axes whose values are shown as words, since one at least is no number."""
        return frozenset(
            path
            for path, axis in self.space.axes.items()
            if isinstance(axis, Values | Ensemble) and any(not isinstance(v, int | float) for v in axis.values)
        )

    def runs(self, points: Iterable[Point], first_point: int = 0) -> Iterator[PlannedFlight]:
        """Yield the runs of some points: every alternative with every seed."""
        for number, point in enumerate(points, first_point):
            for alternative in self.space.alternatives:
                if point.alternatives is None or alternative.name in point.alternatives:
                    yield from self._runs(number, point, alternative)

    def _runs(self, number: int, point: Point, alternative: Alternative) -> Iterator[PlannedFlight]:
        changes = alternative.changes | point.changes
        tree = varied(self.space.base, changes)
        shown: dict[str, Any] = {self.contrast: alternative.name} if self.contrast else {}
        for path in point.changes:
            if path in self.space.axes:
                axis = self.space.axes[path]
                is_whole = isinstance(axis, Ensemble)
                value = axis.name_of(point.changes[path]) if is_whole else shown_value(value_at(tree, path))
                shown[path] = str(value) if path in self.words else value
        for seed in point.seeds or self.space.seeds:
            text = text_of(with_seed(tree, seed))
            place = {
                "point": number,
                "alternative": alternative.name,
                "replicate": seed - self.space.seeds.start,
                "seed": seed,
            }
            yield PlannedFlight(run_id(text), text, {**place, **shown, **point.labels}, changes, point.keep)


def plan_of(study: Study) -> StudyPlan:
    """Check a study as far as can be without flying.

    Raises:
        HeliTwinError: One sentence: an unknown path, a value out of bounds, an empty axis, a design that the axes do
            not fit, or far too many runs.
    """
    study = _with_named_programs(study)
    study = with_own_members(study)
    if len(study.axes) > MAX_AXES:
        raise StudyError(f"this study has {len(study.axes):,} axes: at most {MAX_AXES}")
    base = _base(study)
    axes = {path: axis_of(path, written) for path, written in study.axes.items()}
    alternatives, contrast = alternatives_of(study)
    wholes = [path for path, axis in axes.items() if isinstance(axis, Ensemble)]
    check_apart(wholes, list(axes), {alternative.name: list(alternative.changes) for alternative in alternatives})
    swept = {path: axis for path, axis in axes.items() if path != contrast}
    names = tuple(requirement.name for requirement in study.required)
    plan = StudyPlan(study, Space(base, alternatives, swept, study.seeds, study.score, study.penalty, names), contrast)
    check_metrics((study.score, *study.metrics), names, together=is_several_json(base))
    if "seed" in swept:
        raise StudyError("the seed is no axis: `replicates` flies every point with the same seeds")
    if study.half_width and study.design.adaptive:
        raise StudyError(
            f"half_width = {study.half_width:g} does not go with the design {study.design.kind}, which chooses its"
            " points by their flights: give replicates a number, and half_width = 0"
        )
    study.design.check(plan.space)
    runs = plan.count()
    if runs > study.max_runs:
        raise StudyError(
            f"this study is {_told(runs)} flights, more than max_runs = {study.max_runs:,}: take fewer values or "
            "replicates, or raise max_runs"
        )
    # No flight is refused later.
    for _ in corners(plan.space):
        pass
    return plan


def outside(plan: StudyPlan) -> list[str]:
    """Return where plans of a study leave the envelope of the calibration that it begins with, a phrase a range."""
    envelope = study_envelope(plan.study)
    if envelope is None:
        return []
    phrases = (phrase for experiment in corners(plan.space) for phrase in envelope.left_by(planned_reach(experiment)))
    # The first words name the range.
    return list({phrase.partition(" ")[0]: phrase for phrase in phrases}.values())


def study_envelope(study: Study) -> Envelope | None:
    """Return the envelope that a study's base says, or that of the calibration which it begins with."""
    table = study.base.get("envelope")
    if table is not None:
        return envelope_of(table, "base.envelope")
    preset = study.base.get("preset")
    return envelope_in(preset) if isinstance(preset, str) else None


def _with_named_programs(study: Study) -> Study:
    """The study with the programs of external laws named by their marks, as its store keeps it.

    Raises:
        StudyError: A program cannot be run here.
    """
    try:
        design: Any = study.design
        changes = {f.name: with_commands(getattr(design, f.name), named, f.name) for f in fields(design)}
        tables = {name: with_commands(getattr(study, name), named) for name in ("base", "alternatives", "axes")}
        return replace(study, design=replace(design, **changes), **tables)
    except ValueError as error:
        raise StudyError(f"controller.{error}") from None


def _told(runs: int) -> str:
    return f"{runs:,}" if runs < HUGE_COUNT else "more than 10^15"


def _base(study: Study) -> str:
    """The base experiment, with the study's changes."""
    changes = dict(study.base)
    preset = changes.pop("preset", None)
    changes.pop("envelope", None)
    if preset is not None and not isinstance(preset, str):
        raise StudyError(f"base.preset = {clean(preset, 60)} names no preset. Available: {', '.join(presets())}")
    # A law that is named by its kind alone believes what a calibration says.
    kinds = [f"{part}={changes[part]}" for part in ("controller", "estimator") if isinstance(changes.get(part), str)]
    if preset is not None and is_several(preset):
        begin = [f"base={changes.pop('base')}"] if "base" in changes else []
        return text_of(varied(several_json(load_several(preset, [*begin, *kinds])), changes))
    return text_of(varied(canonical_json(load(preset, kinds)), changes))


def alternatives_of(study: Study) -> tuple[tuple[Alternative, ...], str]:
    """The alternatives, and the path of the experiment that they replace (empty if they are named ones).

    Without named alternatives an axis over a part of the experiment, such as the controller, gives them.

    Raises:
        StudyError: They are no tables, or that axis has no values.
    """
    if study.alternatives:
        for name, changes in study.alternatives.items():
            if not isinstance(changes, dict):
                text = clean(changes, 60)
                raise StudyError(f"alternatives.{name} = {text}: write the changes it stands for as a table")
        return tuple(Alternative(name, dict(changes)) for name, changes in study.alternatives.items()), ""
    fields_of_both = {**fields_of(Several), **fields_of(Experiment)}
    families = {name for name, part in fields_of_both.items() if isinstance(part.family, OneOf)}
    for path, written in study.axes.items():
        if path in families and not is_ensemble(written):
            levels = axis_of(path, written).levels()
            if not levels:
                raise StudyError(f"axis '{path}' is a part, not a number: list its kinds")
            return tuple(Alternative(shown_value(level), {path: level}) for level in levels), path
    return (Alternative("base", {}),), ""


def corners(space: Space) -> Iterator[Experiment]:
    """Yield every alternative with every value of every axis, of those with a distribution its ends; each helicopter.

    Raises:
        ExperimentError: One of them cannot be flown.
    """
    for alternative in space.alternatives:
        yield from experiments_of(varied(space.base, alternative.changes))
        for path, axis in space.axes.items():
            # Between two numbers that a field accepts it accepts all.
            for value in (
                axis.values if isinstance(axis, Values | Ensemble) else (axis.quantile(0.0), axis.quantile(0.999))
            ):
                yield from experiments_of(varied(space.base, alternative.changes | {path: value}))


def shown_value(value: Any) -> Any:
    """A value as a column shows it: numbers as they are, a table by what it says."""
    if isinstance(value, dict):
        kind = value.get("kind", "")
        rest = [f"{key}={shown_value(inner)}" for key, inner in value.items() if key != "kind"]
        return " ".join([kind, *rest] if kind else rest)
    return json.dumps(value) if isinstance(value, list | tuple) else told(value)


def run_id(experiment: str) -> str:
    """The id of a run: a hash of its validated experiment with all defaults and the seed, and the physics version."""
    return hashlib.sha256(f"{PHYSICS_VERSION}\n{experiment}".encode()).hexdigest()[:16]
