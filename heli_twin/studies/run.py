"""A study from Python: flown, and its rows handed back as an Arrow table."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from heli_twin.studies import STUDIES
from heli_twin.studies.campaign import StudyProgress, embedded, run_study
from heli_twin.studies.errors import StudyError
from heli_twin.studies.results import read_results
from heli_twin.studies.study import Study, load_study

if TYPE_CHECKING:
    import pyarrow as pa


def run(
    study: Study | str,
    out: Path | str | None = None,
    *,
    workers: int | None = None,
    progress: Callable[[StudyProgress], None] = lambda progress: None,
) -> "pa.Table":
    """Fly what a study asks for and has not been flown yet.

    It may be stopped at any time, and the same call goes on. Worker processes load the program that calls it: in a
    script, call it under `if __name__ == "__main__":`.

    Args:
        study: What to fly; or the name of a shipped study, or the path of a TOML file.
        out: Folder for the results; None for `logs/studies/NAME`, as `heli-twin study run` has it.
        workers: Processes; None for one a core.
        progress: Called with the progress.

    Returns:
        One row a run: `outcome`, metrics in SI units by dotted name (`rmse.position`, m), the swept fields by theirs
        (`plant.mass`), and provenance. The metadata of a column tell its unit. `.to_pandas()` and `pl.from_arrow` take
        it.

    Raises:
        HeliTwinError: The study is wrong, or its folder cannot be used.
    """
    if workers is not None and workers < 1:
        raise StudyError(f"workers = {workers}: give 1 or more")
    study = load_study(study) if isinstance(study, str) else study
    folder = Path(out) if out is not None else STUDIES / study.name
    run_study(study, folder, backend=lambda plan, timeout: embedded(plan, timeout, workers), watch=progress)
    return read_results(folder)
