"""The paper, flown again and judged: what `heli-twin paper` does.

Source: Kunz, Huck, Summers, "Fast Model Predictive Control of Miniature Helicopters", ECC 2013.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from time import perf_counter, process_time

from heli_twin.errors import HeliTwinError
from heli_twin.identification.identify import Identified, identify
from heli_twin.paper.baselines import baselines_table
from heli_twin.paper.beyond import beyond_figure, beyond_table
from heli_twin.paper.cases import CASES, WHY_THIS_LAB
from heli_twin.paper.causes import causes
from heli_twin.paper.claims import claims, parameter_rows, timing_claims
from heli_twin.paper.curves import Shown, times_figure
from heli_twin.paper.figures import figures
from heli_twin.paper.flights import Flights, fly_all, fly_task, identification_tasks, tasks
from heli_twin.paper.gains import gains_table
from heli_twin.paper.host import Host, load_average
from heli_twin.paper.page import STYLE, claims_section, figure_section, flown_table
from heli_twin.paper.robustness import Loops, margin_tasks, measure_margins, robustness_table
from heli_twin.paper.verdicts import Claim
from heli_twin.recording import read_log
from heli_twin.recording.log import Timings
from heli_twin.reporting.figure import Figure, Table
from heli_twin.reporting.html_page import Section, html_page, table_section
from heli_twin.terminal_text import pasteable
from heli_twin.whole_file import write_whole

DEFAULT_SEEDS = 6
"""Flights of each case: as few as an interval of a median needs, so that two cores take less than four minutes."""
CountProgress = Callable[[int, int], None]
"""Called with the numbers of finished and of all flights."""


def write_paper(
    out: Path,
    seeds: int = DEFAULT_SEEDS,
    *,
    duration: float = 30.0,
    alone: bool = False,
    progress: CountProgress = lambda done, total: None,
) -> list[Claim]:
    """Fly everything and write `paper.html`, the figures and the logs.

    Args:
        out: Folder for them.
        seeds: How many flights of each case; means need two for an interval, medians six.
        duration: Of each flight, s.
        alone: Fly the cases alone: no doublets that identify (27), and no margins.
        progress: Told of every flight that is over.

    Returns:
        The table of claims.

    Raises:
        HeliTwinError: The folder cannot be written, or the flights of the figures failed.
    """
    if seeds < 1:
        raise HeliTwinError(
            f"--seeds {seeds}: fly at least one seed, two for intervals of means and six for those of"
            f" medians (default: {DEFAULT_SEEDS})"
        )
    load = load_average()
    try:
        out.mkdir(parents=True, exist_ok=True)
        flights, loops, doublets = _fly(out, seeds, duration, alone, progress)
        found = identify((str(path), read_log(path)) for path in doublets) if doublets else None
        judged = list(claims(flights, found))
        timing, host = _timing(duration, load)
        sections = _sections(flights, loops, found, judged, seeds, duration)
        measured = _measured(out, timing, host)
        text = html_page(TITLE, QUESTION, [*sections, *measured], style=STYLE)
        write_whole(out / "paper.html", text.encode())
    except OSError as error:
        raise HeliTwinError(f"cannot write {error.filename or out}: {error.strerror}") from None
    return [*judged, *timing_claims(timing, host)]


TITLE = "Fast Model Predictive Control of Miniature Helicopters, reproduced"
QUESTION = (
    "What Kunz, Huck and Summers (ECC 2013) flew with a Blade mCX2, flown again with its digital twin: claim by claim, "
    f"with the same seeds for every controller. {WHY_THIS_LAB}"
)


def _fly(
    out: Path, seeds: int, duration: float, alone: bool, progress: CountProgress
) -> tuple[Flights, Loops, list[Path]]:
    """Fly it all, the longest flights first."""
    doublets, margins = ([], []) if alone else (list(identification_tasks()), list(margin_tasks()))
    wanted = [*doublets, *tasks(seeds, duration, tuple(CASES))]
    count = len(margins) + len(wanted)
    over = 0

    def one_more() -> None:
        nonlocal over
        over += 1
        progress(over, count)

    progress(0, count)
    rows = fly_all(out, [(measure_margins, margins), (fly_task, wanted)], one_more)
    by_case = {name: [rows[f"{name}-seed{seed}"] for seed in case.seeds(seeds)] for name, case in CASES.items()}
    lost = next((task for task in wanted if task.keep_log and not _log(out, task.id).exists()), None)
    if lost is not None:
        raise HeliTwinError(f"flight {lost.id} has no log: {rows[lost.id]['outcome_text']}; run the command again")
    loops = {task.id: rows[task.id] for task in margins}
    return Flights(out, by_case), loops, [_log(out, task.id) for task in doublets]


def _log(out: Path, task: str) -> Path:
    return out / "logs" / f"{task}.mcap"


def _sections(
    flights: Flights,
    loops: Loops,
    found: Identified | None,
    judged: Sequence[Claim],
    seeds: int,
    duration: float,
) -> Iterator[Section]:
    """Everything that is the same on every run."""
    kinds = [claim.verdict for claim in judged]
    counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
    sentence = f"{counts}. Every verdict follows from the numbers by a rule; computing times stand last, by themselves."
    for shown in figures(flights):
        yield _figure(flights, shown)
    yield claims_section("Verdicts", sentence, judged)
    yield table_section(causes(flights))
    yield table_section(baselines_table(flights))
    yield table_section(robustness_table(flights, loops))
    yield table_section(gains_table())
    yield _figure(flights, beyond_figure(flights))
    yield table_section(beyond_table(flights))
    if found is not None:
        yield table_section(parameters_table(flights.folder, found))
    yield table_section(flown_table(flights, seeds, duration))


def _figure(flights: Flights, shown: Shown) -> Section:
    return figure_section(shown.figure, _drawn(flights.folder, shown.figure), shown.cases, flights)


def _drawn(out: Path, figure: Figure) -> Path:
    from heli_twin.reporting.svg import write_svg

    path = out / f"{figure.name}.svg"
    write_svg(figure, path)
    return path


def parameters_table(out: Path, found: Identified) -> Table:
    """The table of the identified parameters."""
    rows = [
        [name, f"{paper:g}", f"{p.value:.4g} [{p.low:.4g}, {p.high:.4g}]", verdict]
        for name, paper, p, verdict in parameter_rows(found)
    ]
    sentence = (
        f"From {found.seconds:.0f} s of {len(found.logs)} flights of doublets: "
        f"{pasteable('heli-twin', 'identify', out / 'logs')}/identify-*.mcap fits them again."
    )
    return Table("Identified parameters", sentence, ["", "paper (27)", "ours, with 95 % interval", "verdict"], rows)


def _timing(duration: float, load: float | None) -> tuple[Timings, Host]:
    """Fly the circle once more, alone, so that only one core is asked for: measured times and the host."""
    from heli_twin.mission import fly

    passed, worked = perf_counter(), process_time()
    log = fly(CASES["circle"].experiment(0, duration), log_dir=None).log
    share = (process_time() - worked) / (perf_counter() - passed)
    return log.timing, Host(log.metadata.get("cpu", ""), share, load, os.cpu_count() or 1)


def _measured(out: Path, timing: Timings, host: Host) -> Iterator[Section]:
    """The sections that differ from run to run; they stand last."""
    sentence = (
        "Measured on this host while one flight of this command flew alone: these numbers differ from run to run. "
        f"{host.sentence()}"
    )
    yield claims_section("Computing times", sentence, list(timing_claims(timing, host)))
    figure = times_figure(timing)
    yield figure_section(figure, _drawn(out, figure))
