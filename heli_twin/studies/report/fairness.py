"""Facts for a fair comparison: the origin of each controller's gains, the model that it believes, its margins."""

from collections.abc import Iterator
from math import isfinite

from heli_twin.experiment.tree import ExperimentError
from heli_twin.metrics.margins import AXES, Margins
from heli_twin.reporting.figure import Table
from heli_twin.studies.plan import alternatives_of
from heli_twin.studies.report.loop_margins import read_margins
from heli_twin.studies.report.results import Results
from heli_twin.studies.space import experiments_of, varied
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
            laws = [e.controller for e in experiments_of(varied(results.about["base"], changes))]
            rows.append([name, "; ".join(dict.fromkeys(origin(law, results.study.tuning) for law in laws))])
        except ExperimentError:
            rows.append([name, "a class of the user's own, which this report was written without"])
    yield Table("Fairness", FAIRNESS_SENTENCE, ["", "controller, and where its gains come from"], rows)


MARGINS_SENTENCE = (
    "The gain margin is the factor on a stick's effect at which the loop becomes unstable, the delay margin the "
    "further delay at which it does, and Ms the factor by which the loop amplifies a disturbance at its worst "
    "frequency: below 2 is robust, above 3 is near a limit cycle. Measured in flight, in still air, on each "
    "alternative as it begins. A law that errs less at a smaller margin is not better."
)


def stability(results: Results) -> Iterator[Table]:
    """Yield the table of each alternative's margins, where the study has measured them."""
    header = ["", *(f"{axis}: gain margin, delay margin, Ms" for axis in AXES)]
    rows = [
        [name, *([of_law] + [""] * 3 if isinstance(of_law, str) else [_cell(of_law[axis]) for axis in AXES])]
        for name, of_law in read_margins(results.folder).items()
    ]
    if rows:
        yield Table("Margins", MARGINS_SENTENCE, header, rows)


def _cell(m: Margins) -> str:
    gain = f"{m.gain:.2f}" if isfinite(m.gain) else "any"
    delay = f"{1e3 * m.delay:.0f} ms" if isfinite(m.delay) else "any"
    return f"{gain}, {delay}, {m.peak_sensitivity:.2f}"
