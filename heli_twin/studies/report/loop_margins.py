"""Stability margins of a study's alternatives, measured once and kept beside its results."""

import json
from math import inf
from pathlib import Path

from heli_twin.errors import HeliTwinError
from heli_twin.metrics.margins import AXES, Margins
from heli_twin.studies.errors import StudyError
from heli_twin.studies.plan import alternatives_of
from heli_twin.studies.report.results import results_of
from heli_twin.studies.space import experiments_of, varied
from heli_twin.tuning.margins import law_margins
from heli_twin.whole_file import write_whole

FILE = "margins.json"

OfLaw = dict[str, Margins] | str
"""Margins by axis, or one sentence that says why there are none."""


def measure_margins(folder: Path) -> None:
    """Measure the margins of every alternative as it begins, before the design varies anything.

    Args:
        folder: Of the study, with its results.
    """
    results = results_of(folder)
    of_all: dict[str, dict[str, dict[str, float | None]] | str] = {}
    for name, changes in alternatives_of(results.study)[0]:
        try:
            found = law_margins(experiments_of(varied(results.about["base"], changes))[0])
        except HeliTwinError as error:
            of_all[name] = str(error)
        else:
            of_all[name] = {axis: m.plain() for axis, m in found.items()}
    write_whole(folder / FILE, json.dumps(of_all, indent=2, allow_nan=False).encode())


def read_margins(folder: Path) -> dict[str, OfLaw]:
    """Return the margins that were measured; nothing for a study without them.

    Raises:
        StudyError: The file does not hold margins.
    """
    path = folder / FILE
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        return {str(name): _read(value) for name, value in stored.items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, AttributeError, KeyError, RecursionError):
        raise StudyError(f"{path} holds no margins: delete it, or run the study again") from None


def _read(value: object) -> OfLaw:
    if isinstance(value, str):
        return value
    return {axis: Margins(*(inf if v is None else float(v) for v in _of_axis(value, axis))) for axis in AXES}


def _of_axis(value: object, axis: str) -> list[float | None]:
    if not isinstance(value, dict):
        raise TypeError
    return [value[axis][name] for name in Margins._fields]
