"""The last tables of a report: the worst runs, and the provenance."""

from collections.abc import Iterator

from heli_twin.reporting.figure import Table
from heli_twin.studies.flight_code import mixed_codes
from heli_twin.studies.report.results import Results
from heli_twin.studies.store import Store
from heli_twin.studies.worst import worst_runs


def worst(results: Results) -> Iterator[Table]:
    """The ten worst runs."""
    runs = worst_runs(results.folder, 10)
    rows = [[run.id, run.what, run.command] for run in runs]
    sentence = "Flights that failed first, then those with the worst score; each with the command that shows it."
    yield Table("The ten worst", sentence, ["run", "what happened", "command"], rows, codes=(0, 2))


def provenance(results: Results) -> Iterator[Table]:
    """Yield the table of study, machine and versions."""
    about, study = results.about, results.study
    with Store(results.folder) as store:
        mixed = store.codes()
    rows = [
        ["question", study.question],
        ["design", f"{study.design.kind}, {len(results):,} flights, {results.seeds} shared seeds from {study.seed}"],
        ["stopped", f"each mean {study.score} is known to +-{study.half_width:g}; {about['saved']:,} flights saved"]
        if study.half_width and about.get("saved")
        else ["", ""],
        ["rows", f"{results.folder / 'results.parquet'}"],
        ["launched", f"{about.get('launched', '')} on {about.get('host', '')}, {about.get('cores', '')} cores"],
        ["code", f"{len(mixed)} versions are mixed: {mixed_codes(mixed)}" if len(mixed) > 1 else about.get("code", "")],
        *([key.removeprefix("with."), str(value)] for key, value in about.items() if key.startswith("with.")),
    ]
    skipped = {"started", "processes"}
    rows = [row for row in rows if row[0] not in skipped and row[1]]
    yield Table("Provenance", "What was flown, with what, where.", ["", ""], rows)
