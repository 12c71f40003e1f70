"""Stability margins of each compared law, and its errors on other helicopters."""

from collections.abc import Iterator, Mapping
from math import isfinite

from heli_twin.errors import HeliTwinError
from heli_twin.experiment.tree import canonical_json
from heli_twin.paper.cases import ATTITUDE, ATTITUDES, CASES, FEW_SEEDS, LAB, LAWS, at_attitude
from heli_twin.paper.claims import CM
from heli_twin.paper.comparison import in_plane
from heli_twin.paper.flights import Flights
from heli_twin.reporting.figure import Table
from heli_twin.reporting.words import number
from heli_twin.studies.columns import COMPLETED
from heli_twin.studies.designs import Row
from heli_twin.tuning.margins import HELICOPTERS, Helicopter, law_margins
from heli_twin.workers.task import Flown, Task

LOOPS = {"circle_error": "circle_pid", "circle_flat": "circle_pid"}
"""Laws that have the loop of another: their terms of the reference are outside of it."""
Loops = Mapping[str, Row]
"""The row of each task of `margin_tasks`, by its id."""


def margin_tasks() -> Iterator[Task]:
    """One task for each loop: the law on the twin, and on the helicopter that it believes in."""
    for case in LAWS:
        if case not in LOOPS:
            text = canonical_json(CASES[case].experiment(0, 1.0))
            for helicopter in HELICOPTERS:
                yield Task(_id(case, helicopter), text, helicopter, False, False, None)


def measure_margins(task: Task) -> Flown:
    """The work of a worker process: the margins of the x loop, and the largest Ms of all loops."""
    from heli_twin.experiment.tree import from_json

    helicopter: Helicopter = "believed" if task.score == "believed" else "twin"
    try:
        loops = law_margins(from_json(task.experiment), helicopter)
    except HeliTwinError as error:
        return Flown({"outcome": "unstable", "outcome_text": str(error)})
    worst = max(loop.peak_sensitivity for loop in loops.values())
    return Flown({"outcome": COMPLETED, **loops["x"]._asdict(), "worst_sensitivity": worst})


def robustness_table(flights: Flights, loops: Loops) -> Table:
    """The table of errors at each frequency of attitude, and of margins."""
    frequencies = sorted((*ATTITUDES, ATTITUDE))
    rows = [
        [
            CASES[case].label,
            *(number(CM * in_plane(flights, at_attitude(case, frequency))) for frequency in frequencies),
            *(_margins(loops.get(_id(LOOPS.get(case, case), helicopter))) for helicopter in HELICOPTERS),
        ]
        for case in LAWS
    ]
    sentence = (
        f"The circle in {LAB}, rms error in the plane with pitch and roll as slow and as fast as published values"
        f" ({ATTITUDE} rad/s is the lab's; at the others the first {FEW_SEEDS} seeds). Beside it the margins of the x"
        " loop, measured in hover with small sines on the commands: gain margin, delay margin, peak sensitivity Ms,"
        " and the largest Ms of all four loops. Below 2 Ms is robust, above 3 it is near a limit cycle."
    )
    header = ["", *(f"at {frequency} rad/s, cm" for frequency in frequencies), "on the twin", "on what it believes in"]
    return Table("Margins, and other helicopters", sentence, header, rows)


def _margins(row: Row | None) -> str:
    if row is None:
        return "not measured"
    if row["outcome"] != COMPLETED:
        return "unstable"
    gain, delay = float(row["gain"]), float(row["delay"])
    return (
        f"gain {f'{gain:.2f}' if isfinite(gain) else 'no limit'}, delay"
        f" {f'{1e3 * delay:.0f} ms' if isfinite(delay) else 'no limit'}, Ms {row['peak_sensitivity']:.2f}"
        f" (worst of all {row['worst_sensitivity']:.2f})"
    )


def _id(case: str, helicopter: Helicopter) -> str:
    return f"margins-{case}-{helicopter}"
