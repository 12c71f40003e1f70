"""The rows of a study as columns of numbers, for the sections of the report."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_twin.reporting.figure import Array
from heli_twin.studies.columns import COMPLETED, INVALID, SCORED
from heli_twin.studies.errors import StudyError
from heli_twin.studies.results import read_results
from heli_twin.studies.store import Store
from heli_twin.studies.study import Study, stored_study
from heli_twin.terminal_text import pasteable

PLACE_COLUMNS = ("id", "alternative", "point", "replicate", "seed")
FLIGHT_COLUMNS = ("outcome", "outcome_text", "effort", "controller.period")
DESIGN_COLUMNS = ("rung", "height", "varied", "level", "matrix", "sample", "trajectory", "move", "moved", "by")
SEARCH_COLUMNS = ("axis", "share", "value", "found_by", "trial", "asked")
RARE_COLUMNS = ("state", "factor", "change", "axes_size", "noise_size")
TIMES = ("solve_ms.p50", "solve_ms.p99", "solve_ms.max", "control_step_ms.p99", "control_step_ms.max")

INDEPENDENT_SENTENCE = (
    "This needs independent axes: of axes that really vary together it says nothing; an ensemble is one axis."
)
"""The limit of methods that move or draw each axis by itself."""


@dataclass(frozen=True)
class Results:
    """A study's rows, column by column."""

    folder: Path
    study: Study
    about: Mapping[str, Any]
    columns: Mapping[str, NDArray[Any]]
    invalid: int = 0
    """Number of runs that are left out, since the process of their control law failed."""

    def __len__(self) -> int:
        return len(self.columns["id"])

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def __getitem__(self, name: str) -> NDArray[Any]:
        """A column; all missing where no flight has it."""
        return self.columns.get(name, np.full(len(self), np.nan))

    def where(self, mask: NDArray[np.bool_]) -> "Results":
        """Return the rows of a mask."""
        return replace(self, columns={name: column[mask] for name, column in self.columns.items()})

    def of(self, alternative: str) -> "Results":
        """The rows of one alternative."""
        return self.where(self["alternative"] == alternative)

    @cached_property
    def alternatives(self) -> list[str]:
        """The names of the alternatives, in the order of the study."""
        names, first = np.unique(self["alternative"].astype(str), return_index=True)
        return [str(names[i]) for i in np.argsort(first)]

    @cached_property
    def seeds(self) -> int:
        """The number of seeds that were flown: an interval needs two at least."""
        return len(np.unique(self["seed"]))

    @property
    def one_seed(self) -> str:
        """A warning for sentences without intervals; empty with several seeds."""
        return "" if self.seeds > 1 else " (one seed, so differences may be chance)"

    @cached_property
    def failed(self) -> NDArray[np.bool_]:
        """A mask of the flights that did not complete, or broke a requirement."""
        return self["outcome"] != COMPLETED

    @cached_property
    def scored(self) -> NDArray[np.bool_]:
        """A mask of the flights that flew to their end, so that their metrics can be compared."""
        return np.isin(self["outcome"].astype(str), SCORED)

    @cached_property
    def axes(self) -> list[str]:
        """The swept paths, without the one that the alternatives stand for."""
        return [path for path in self.study.axes if path in self.columns and self.is_axis(path)]

    def is_axis(self, path: str) -> bool:
        """Return whether a column varies within an alternative."""
        names, column = self["alternative"], self[path]
        return not (column.dtype == object and bool(np.all(column == names)))

    def is_number(self, path: str) -> bool:
        """Return whether the values of an axis are numbers."""
        return self[path].dtype != object

    def metric(self, name: str) -> Array:
        """A metric of the flights that completed; NaN for the others, which `failed` counts."""
        return np.where(self.scored, self[name].astype(float), np.nan)

    @property
    def penalised(self) -> Array:
        """The score, with the study's penalty for those that failed."""
        score = self[self.study.score].astype(float)
        return np.where(~self.scored | np.isnan(score), self.study.penalty, score)

    def command(self, row: int) -> str:
        """The command that flies the run of a row again."""
        return pasteable("heli-twin", "study", "fly", self.folder, self["id"][row])


def error_bars(results: Results) -> str:
    """The end of a sentence: what the thin lines are."""
    return "; thin lines are 95 % intervals over the seeds" if results.seeds > 1 else ""


def results_of(folder: Path) -> Results:
    """The rows of a study's folder.

    Raises:
        StudyError: There are none.
    """
    with Store(folder) as store:
        about = store.about()
    study = stored_study(about["study"])
    fixed = (*PLACE_COLUMNS, *FLIGHT_COLUMNS, *DESIGN_COLUMNS, *SEARCH_COLUMNS, *RARE_COLUMNS, *TIMES)
    wanted = [*fixed, *study.axes, study.score, *study.metrics, *_criteria(study)]
    table = read_results(folder, list(dict.fromkeys(wanted)))
    columns = {name: _column(table.column(name)) for name in table.column_names}
    results = Results(folder, study, about, columns)
    is_invalid = results["outcome"] == INVALID
    if is_invalid.all():
        reason = results["outcome_text"][0]
        raise StudyError(f"all runs of {folder} are invalid, the first since {reason}: mend the program, run it again")
    return replace(results.where(~is_invalid), invalid=int(is_invalid.sum()))


def _criteria(study: Study) -> list[str]:
    return list(getattr(study.design, "criteria", ()))


def _column(column: Any) -> NDArray[Any]:
    """Numbers as floats with NaN for nothing; anything else as objects."""
    import pyarrow as pa

    if pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
        return column.cast(pa.float64()).to_numpy(zero_copy_only=False)
    if pa.types.is_string(column.type):
        coded = column.combine_chunks().dictionary_encode()
        coded = coded.combine_chunks() if isinstance(coded, pa.ChunkedArray) else coded
        words = np.array([*coded.dictionary.to_pylist(), None], dtype=object)
        return words[np.asarray(coded.indices.fill_null(-1))]
    return np.array(column.to_pylist(), dtype=object)
