"""Facts for a fair comparison: the origin of each controller's gains, and the model that it believes."""

from collections.abc import Iterator

from heli_twin.experiment.tree import ExperimentError, experiment_of
from heli_twin.reporting.figure import Table
from heli_twin.studies.plan import alternatives_of
from heli_twin.studies.report.results import Results
from heli_twin.studies.space import varied
from heli_twin.tuning.record import origin

FAIRNESS_SENTENCE = (
    "All alternatives fly the same seeds. What a controller knows of the helicopter is its own `controller.model`: "
    "trim and limits come from there, never from the plant. The table tells each controller as its alternative begins, "
    "before the design varies anything."
)


def fairness(results: Results) -> Iterator[Table]:
    """Yield the table of each alternative's controller and its tuning."""
    rows: list[list[str]] = []
    for name, changes in alternatives_of(results.study)[0]:
        try:
            law = experiment_of(varied(results.about["base"], changes)).controller
            rows.append([name, origin(law, results.study.tuning)])
        except ExperimentError:
            rows.append([name, "a class of the user's own, which this report was written without"])
    yield Table("Fairness", FAIRNESS_SENTENCE, ["", "controller, and where its gains come from"], rows)
