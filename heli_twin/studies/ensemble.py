"""Helicopters of a calibration as an axis: parameters that go together are drawn together, whole helicopters.

`heli-twin calibrate --out DIR` writes `DIR/ensemble.toml`: helicopters drawn from the posterior, whose parameters are
correlated. `plant = { ensemble = "DIR/ensemble.toml" }` makes them one axis of any study.
"""

import tomllib
from pathlib import Path
from typing import Any

from heli_twin.experiment.tree import Tree
from heli_twin.studies.errors import StudyError
from heli_twin.terminal_text import clean

MOST = 1000
"""Helicopters of one ensemble."""


def embedded(axes: Tree, folder: Path) -> Tree:
    """Return axes with the helicopters of each ensemble in place of the name of its file.

    Args:
        axes: As a study file writes them.
        folder: Where the files are.

    Raises:
        StudyError: A file cannot be read, or holds no ensemble.
    """
    return {path: _embedded(path, written, folder) for path, written in axes.items()}


def _embedded(path: str, written: Any, folder: Path) -> Any:
    if not is_ensemble(written) or not isinstance(written["ensemble"], str):
        return written
    file = folder / written["ensemble"]
    try:
        tree = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not valid TOML"
        raise StudyError(f"axis '{path}': cannot read the ensemble {clean(file, 200)}: {reason}") from None
    draws = tree.get("alternatives")
    draws = draws if isinstance(draws, dict) else {}
    found = {name: changes.get(path) if isinstance(changes, dict) else None for name, changes in draws.items()}
    if not found or len(found) > MOST or not all(isinstance(value, dict) for value in found.values()):
        raise StudyError(
            f"axis '{path}': {clean(file, 200)} holds no ensemble of 1 to {MOST} tables `alternatives.NAME.{path}`:"
            " `heli-twin calibrate --out DIR` writes DIR/ensemble.toml"
        )
    return {"ensemble": found}


def is_ensemble(written: Any) -> bool:
    """Return whether an axis as a study file writes it is an ensemble."""
    return isinstance(written, dict) and set(written) == {"ensemble"}


def check_apart(ensembles: list[str], axes: list[str], alternatives: dict[str, list[str]]) -> None:
    """Refuse axes and alternatives that change what an ensemble sets.

    Args:
        ensembles: Paths of the axes that are ensembles.
        axes: Paths of all axes.
        alternatives: Paths that each alternative changes.

    Raises:
        StudyError: Names the two.
    """
    for whole in ensembles:
        for path in axes:
            if path.startswith(f"{whole}."):
                raise StudyError(
                    f"axis '{path}' is a part of axis '{whole}', an ensemble whose parameters go together:"
                    " leave one out"
                )
        for name, paths in alternatives.items():
            if part := next((p for p in paths if p == whole or p.startswith(f"{whole}.")), None):
                raise StudyError(
                    f"alternative '{clean(name, 40)}' changes {part}, which the ensemble of axis '{whole}' sets: leave"
                    " one out"
                )
