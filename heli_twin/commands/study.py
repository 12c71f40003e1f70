"""`heli-twin study`: fly many experiments and learn where and how the controller breaks."""

import sys
from argparse import ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from heli_twin.commands import add_with, command, file_path, load_with, progress_bar, say
from heli_twin.studies import PAGE, STUDIES
from heli_twin.terminal_text import clean, pasteable

if TYPE_CHECKING:
    from heli_twin.studies.campaign import StudyProgress
    from heli_twin.studies.plan import StudyPlan
    from heli_twin.studies.report.progress import ProgressPage
    from heli_twin.studies.study import Study
    from heli_twin.workers.engine import Backend

TEMPLATE = Path(__file__).parents[1] / "studies" / "template.toml"
"""The study with comments that `heli-twin study new` writes."""


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command and its own subcommands."""
    parser = subparsers.add_parser(
        "study",
        help="fly many experiments, on all cores or a cluster, and report",
        description="Fly many experiments and learn where and how the controller breaks.",
        allow_abbrev=False,
    )
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    _add_run(actions)
    folder = ("a study's folder, its file, or the name of a shipped study",)
    for name, run, summary, example in (
        ("status", status, "how far a study is", "  heli-twin study status ladder\n"),
        ("report", report, "write report.html and the figures", "  heli-twin study report ladder\n"),
        (
            "worst",
            worst,
            "the worst runs, each with the command that flies it again",
            "  heli-twin study worst ladder -n 3\n",
        ),
    ):
        sub = command(actions, name, run, summary, f"Say {summary}." if name == "status" else summary, example)
        sub.add_argument("study", help=folder[0])
        if name == "worst":
            sub.add_argument("-n", type=int, default=10, metavar="N", help="how many (default 10)")
        if name == "report":
            sub.add_argument("--out", type=Path, metavar="DIR", help="for the report (default: the study's folder)")
    fly = command(actions, "fly", refly, "fly one run again", "Fly one run again, by the id in a report.", REFLY)
    fly.add_argument("study", help=folder[0])
    fly.add_argument("id", help="the run's id, or how it begins")
    add_with(fly)
    command(actions, "list", listing, "the studies that come with heli_twin", "List them.", "  heli-twin study list")
    shown = command(
        actions,
        "show",
        show_file,
        "print a shipped study, to read it or to begin with it",
        "Print the file of a study that comes with heli_twin. What it prints, `heli-twin study run` takes.",
        "  heli-twin study show mass\n  heli-twin study show mass > mine.toml\n  heli-twin study run mine.toml",
    )
    shown.add_argument("study", metavar="NAME", help="of a shipped study: `heli-twin study list`")
    new = command(
        actions,
        "new",
        new_file,
        "write a study file with comments, to change",
        "Write a study file in which comments explain every part. It can be flown as it is: 24 flights of 10 s.",
        "  heli-twin study new mine.toml\n  heli-twin study run mine.toml",
    )
    new.add_argument("file", type=file_path, metavar="FILE.toml", help="the file to write")


def _add_run(actions: "_SubParsersAction[ArgumentParser]") -> None:
    run = command(
        actions,
        "run",
        run_,
        "fly a study; run it again to go on",
        RUN_HELP,
        RUN,
    )
    run.add_argument("study", metavar="FILE", help="a study file, or the name of a shipped study")
    run.add_argument(
        "overrides",
        nargs="*",
        default=[],
        metavar="field=value",
        help="changes of the study, or of its base experiment",
    )
    run.add_argument("--out", type=Path, metavar="DIR", help=f"where results go (default {STUDIES}/NAME)")
    run.add_argument("--workers", type=int, metavar="N", help="processes on this machine (default one a core)")
    run.add_argument(
        "--scheduler", metavar="ADDRESS", help="fly on a Dask cluster: tcp://HOST:8786, or a scheduler file"
    )
    run.add_argument(
        "--again",
        action="store_true",
        help="fly the runs again that were killed, hung or raised, or flown by other code",
    )
    run.add_argument("--accept-old", action="store_true", help="keep the rows of runs that other code flew")
    run.add_argument("--no-report", action="store_true", help="write no report at the end")


RUN_HELP = """Fly a study. Ctrl-C stops it; run it again to go on.

A study file asks one question:
  [base]          the experiment that is varied: `preset`, and changes of its fields
  [alternatives]  what is compared, each a name and the changes that it stands for:
                    "PID" = { controller = { kind = "pid" } }
  [axes]          what is swept, any field by its path: a list of values, or { linspace = [FROM, TO, COUNT] },
                    { logspace = [FROM, TO, COUNT] }, { uniform = [FROM, TO] }, { normal = [MEAN, DEVIATION] }:
                    "plant.mass" = { linspace = [0.024, 0.034, 5] }
                    or all helicopters of a calibration: plant = { ensemble = "DIR/ensemble.toml" }
  [design]        which points of the axes are flown: grid (all), one_at_a_time, latin_hypercube, monte_carlo, morris,
                    sobol, margin, boundary, worst_case, rare_event, ladder, or a class of your own
  replicates      flights of each point; every point and alternative flies the same seeds. "auto" with a half_width:
                    as many as give each mean score a 95 % interval of +- half_width
  score, metrics  what ranks flights, and what else the report compares

On the command line: replicates=5, axes.plant.mass='[0.028, 0.032]', alternatives.PID='{controller="pid"}',
design=sobol, or any field of the base, duration=10. `heli-twin study new mine.toml` writes a file with comments,
`heli-twin study show mass` prints a shipped one, `heli-twin guide studies` tells more."""
RUN = (
    "  heli-twin study run ladder\n"
    "  heli-twin study run thrust_gain replicates=3 duration=10\n"
    "  heli-twin study run mine.toml --out results/mine --workers 4\n"
    "  heli-twin study run mine.toml --scheduler tcp://head:8786\n"
)
REFLY = "  heli-twin study fly ladder 3f2a91\n"


def run_(parsed: Namespace) -> int:
    """Fly a study; 0 when every flight brought a row back, 1 when some did not or were invalid."""
    if not parsed.scheduler:
        from heli_twin.workers.pebble_pool import begin_to_load

        begin_to_load()
    from heli_twin.studies.campaign import run_study
    from heli_twin.studies.errors import StudyError
    from heli_twin.studies.study import load_study

    if parsed.workers is not None and parsed.workers < 1:
        raise StudyError(f"--workers {parsed.workers}: give 1 or more")
    study = load_study(parsed.study, parsed.overrides)
    warn_outside(study)
    out = parsed.out or STUDIES / study.name
    try:
        with Watch(study, out) as watch:
            options = {"again": parsed.again, "accept_old": parsed.accept_old}
            count = run_study(study, out, backend=_backend(parsed), watch=watch, **options)
    except KeyboardInterrupt as stop:
        stop.add_note(f"what was flown is kept in {out}, and the same command goes on")
        raise
    say(_summary(count, out))
    if study.margins:
        from heli_twin.studies.report.loop_margins import FILE, measure_margins

        if not (out / FILE).exists():
            say("measuring the stability margins of each alternative")
            measure_margins(out)
    tell(out)
    if not parsed.no_report:
        from heli_twin.studies.report import write_report

        say(f"report {write_report(out)}")
    return 1 if {"killed", "hung", "error", "invalid"} & count.failed.keys() else 0


def tell(folder: Path) -> None:
    """Print the answer of a study that asks how often a flight fails, where, or which axes matter."""
    from heli_twin.studies.errors import StudyError
    from heli_twin.studies.report.boundary import told_boundary
    from heli_twin.studies.report.bounds import told_bounds
    from heli_twin.studies.report.morris import told_morris
    from heli_twin.studies.report.rare_event import told_rare_event
    from heli_twin.studies.report.results import results_of

    try:
        results = results_of(folder)
    except StudyError:
        # No run is valid, as the report says.
        return
    for line in (*told_bounds(results), *told_rare_event(results), *told_boundary(results), *told_morris(results)):
        say(line)


def warn_outside(study: "Study") -> None:
    """Say where plans leave what the flights of a calibration covered that the study begins with."""
    from heli_twin.studies.plan import outside, plan_of, study_envelope

    left = outside(plan_of(study)) if study_envelope(study) else []
    if left:
        print(
            "heli-twin: the calibrated helicopter is a guess for some flights, whose plans leave what its flights"
            f" covered: {'; '.join(left)}",
            file=sys.stderr,
        )


def _backend(parsed: Namespace) -> "Callable[[StudyPlan, float], Backend]":
    from heli_twin.studies.campaign import embedded
    from heli_twin.studies.errors import StudyError

    def here(plan: "StudyPlan", timeout: float) -> "Backend":
        return embedded(plan, timeout, parsed.workers)

    if not parsed.scheduler:
        return here
    try:
        from heli_twin.workers.dask_cluster import DaskCluster
    except ImportError:
        raise StudyError("--scheduler needs Dask: pip install 'heli-twin[cluster]'") from None

    def there(plan: "StudyPlan", timeout: float) -> "Backend":
        return DaskCluster(parsed.scheduler, timeout)

    return there


def _summary(count: "StudyProgress", out: Path) -> str:
    kinds = ", ".join(f"{number} {kind}" for kind, number in sorted(count.failed.items()))
    saved = f", {count.saved:,} were not needed" if count.saved else ""
    now = f"{count.flown} of them flown now{f' ({kinds})' if kinds else ''}{saved}"
    return f"{count.done} runs, {now}; results in {out}"


class Watch:
    """Progress for a person: a bar on a terminal, else a line now and then, and a page that refreshes itself."""

    def __init__(self, study: "Study", folder: Path) -> None:
        self._study, self._folder = study, folder
        self._page: ProgressPage | None = None
        self._name = clean(study.name, NAME_LIMIT)
        self._bar = progress_bar()
        self._task = self._bar.add_task(self._name, total=None)
        self._began = self._said = monotonic()

    def __call__(self, count: "StudyProgress") -> None:
        """Show how far it is."""
        now = monotonic()
        if now - self._began > PAGE_AFTER_S:
            self._page = self._page or self._new_page()
            self._page(count)
        rate = count.flown / max(now - self._began, 1e-3)
        failed = ", ".join(f"{number} {kind}" for kind, number in sorted(count.failed.items()))
        speed = f" {rate:.1f}/s" if count.flown else ""
        text = f"{self._name}{speed} {failed}"
        self._bar.update(self._task, total=count.total, completed=count.done, description=text)
        if self._bar.disable and now - self._said > PROGRESS_PERIOD_S and count.flown:
            self._said = now
            left = (count.total - count.done) / max(rate, 1e-9)
            print(
                f"{count.done} of {count.total}, {rate:.1f}/s, {left:.0f} s left {failed}", file=sys.stderr, flush=True
            )

    def __enter__(self) -> "Watch":
        self._bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._bar.stop()
        # A launch before this one may have left a page.
        if self._page or (self._folder / PAGE).is_file():
            page = self._page or self._new_page()
            page.close("finished" if error[0] is None else "stopped: the same command goes on")

    def _new_page(self) -> "ProgressPage":
        # Drawing takes as long to import as seven flights of 4 s.
        from heli_twin.studies.report.progress import ProgressPage

        return ProgressPage(self._study, self._folder, self._began)


PAGE_AFTER_S = 30.0
"""A study that is over sooner needs no page of its progress."""
PROGRESS_PERIOD_S = 10.0
"""Time between two lines of progress where there is no terminal."""
NAME_LIMIT = 40
"""Characters of a study's name beside its progress bar."""


def folder_of(name: str) -> Path:
    """The folder of a study that is named by its folder, its file or its shipped name.

    Raises:
        HeliTwinError: There is none.
    """
    from heli_twin.studies.store import Store
    from heli_twin.studies.study import load_study

    folder = Path(name)
    if not folder.is_dir():
        folder = STUDIES / name if (STUDIES / name).is_dir() else STUDIES / load_study(name).name
    Store(folder).close()
    return folder


def status(parsed: Namespace) -> int:
    """Print how far a study is."""
    from heli_twin.studies.flight_code import mixed_codes
    from heli_twin.studies.store import Store

    folder = folder_of(parsed.study)
    with Store(folder) as store:
        about, outcomes, mixed = store.about(), store.outcomes(), store.codes()
    done, planned = outcomes.total(), about.get("planned", 0)
    say(f"{about['study']['name']}: {done} of {planned} runs" + ("" if "finished" in about else ", not finished"))
    for outcome, number in outcomes.most_common():
        say(f"  {number:>7} {outcome}")
    if len(mixed) > 1:
        say(f"  flown by code of {len(mixed)} versions: {mixed_codes(mixed)}")
    say(f"launched {about['launched']} on {about['host']}, results in {folder}")
    return 0


def report(parsed: Namespace) -> int:
    """Write the report of a study."""
    from heli_twin.studies.report import write_report

    folder = folder_of(parsed.study)
    page = write_report(folder, parsed.out)
    tell(folder)
    say(f"report {page}")
    return 0


def worst(parsed: Namespace) -> int:
    """Print the worst runs: those that failed, then those with the worst score."""
    from heli_twin.studies.errors import StudyError
    from heli_twin.studies.worst import worst_runs

    if parsed.n < 1:
        raise StudyError(f"-n {parsed.n}: give 1 or more")
    folder = folder_of(parsed.study)
    for run in worst_runs(folder, parsed.n):
        say(f"{run.id}  {run.what}")
        print(f"    {run.command}")
    return 0


def refly(parsed: Namespace) -> int:
    """Fly one run again and keep its log in the study's folder."""
    from heli_twin.commands.fly import exit_code, show
    from heli_twin.experiment import tree
    from heli_twin.experiment.own import other_program
    from heli_twin.mission import fly
    from heli_twin.studies.worst import experiment_by_id

    load_with(parsed)
    folder = folder_of(parsed.study)
    text = experiment_by_id(folder, parsed.id)
    experiment = tree.from_json(text)
    for notice in other_program(tree.parsed(text), experiment):
        say(notice)
    result = fly(experiment, log_dir=folder / "reflown")
    show(result.summary())
    return exit_code(result)


def show_file(parsed: Namespace) -> int:
    """Print the file of a shipped study."""
    from heli_twin.studies.errors import StudyError
    from heli_twin.studies.study import shipped
    from heli_twin.terminal_text import instead

    known = shipped()
    if parsed.study not in known:
        raise StudyError(f"unknown study {instead(parsed.study, known)}")
    print(known[parsed.study].read_text(encoding="utf-8"), end="")
    return 0


def new_file(parsed: Namespace) -> int:
    """Write the template of a study."""
    from heli_twin.studies.errors import StudyError
    from heli_twin.whole_file import write_whole

    if parsed.file.suffix != ".toml":
        raise StudyError(f"cannot write {parsed.file}: give the study a name that ends in .toml")
    if parsed.file.exists():
        raise StudyError(f"{parsed.file} exists already: choose another name, or delete it")
    write_whole(parsed.file, TEMPLATE.read_bytes())
    again = pasteable("heli-twin", "study", "run", parsed.file)
    say(f"wrote {parsed.file}: change it, then `{again}`")
    return 0


def listing(parsed: Namespace) -> int:
    """Print the shipped studies."""
    from heli_twin.studies.plan import plan_of
    from heli_twin.studies.study import load_study, shipped

    for name in shipped():
        study = load_study(name)
        say(f"{name:<24} {study.design.kind:<16} {plan_of(study).count():>6} runs  {study.question}")
    return 0
