"""`heli-twin refly`: fly a log's experiment again."""

from argparse import ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heli_twin.commands import add_with, command, file_path, load_with, progress_bar, say
from heli_twin.commands.fly import INVALID_RUN, requirements_named, verdicts_on
from heli_twin.commands.judge import BROKEN
from heli_twin.terminal_text import clean

if TYPE_CHECKING:
    from heli_twin.reanalysis.refly import Refly
    from heli_twin.recording import Log
    from heli_twin.requirements import Verdict


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "refly",
        run,
        "fly a recorded experiment again, as it was or with changes",
        "Rebuild the experiment from a log alone and fly it. Without changes it says `identical`, or where, when and\n"
        "in which field the flights first differ: bit for bit on the same host and build, elsewhere within 2 mm and\n"
        "0.5 deg. With changes it prints both results; with --require, how the margin of each requirement changed.\n"
        "Exit code 1 means that the flights differ, 3 that the second flight breaks a requirement or is invalid.",
        "  heli-twin refly RUN.mcap\n"
        "  heli-twin refly RUN.mcap controller.horizon=12\n"
        "  heli-twin refly RUN.mcap controller.horizon=12 --require circle\n"
        "  heli-twin refly RUN.mcap plant.mass=0.030 seed=3 --log-dir again",
    )
    parser.add_argument("log", type=file_path, metavar="RUN.mcap", help="a log that heli-twin fly recorded")
    parser.add_argument("overrides", nargs="*", default=[], metavar="path.to.field=value", help="what to change")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--log-dir", type=Path, metavar="DIR", help="where the new log goes (default logs/; none without changes)"
    )
    where.add_argument("--no-log", action="store_true", help="keep no log")
    parser.add_argument("--require", metavar="REQ.toml|NAME", help="requirements, as `heli-twin judge` takes them")
    add_with(parser)
    parser.add_argument("--yes", action="store_true", help="do it even if it takes longer than ten minutes")


def run(parsed: Namespace) -> int:
    """Fly it again; the exit code is 1 when an unchanged experiment flew differently."""
    import numpy as np

    from heli_twin.flight import INVALID
    from heli_twin.logbook import own_notices, physics_notice
    from heli_twin.reanalysis.effort import require_agreement
    from heli_twin.reanalysis.refly import refly
    from heli_twin.recording import read_log
    from heli_twin.requirements import judge as judge_log

    load_with(parsed)
    requirements, log = requirements_named(parsed.require), read_log(parsed.log)
    before = judge_log(requirements, log) if requirements else {}
    for notice in (physics_notice(log), *own_notices(log)):
        if notice:
            say(notice)
    differs, duration, effort = _asked(log, parsed.overrides)
    require_agreement(effort, "flying this log again", parsed.yes)
    log_dir = None if parsed.no_log else parsed.log_dir or (Path("logs") if differs else None)
    with progress_bar() as bar:
        task = bar.add_task("flying, s", total=duration)
        again = refly(log, parsed.overrides, log_dir=log_dir, progress=lambda t: bar.update(task, completed=t))
    if again.result.outcome.kind == INVALID:
        say(f"invalid: {again.result.outcome.text}")
    elif differs:
        with np.errstate(all="ignore"):
            compare(again)
    else:
        judge(again)
    after = verdicts_on(requirements, again.result)
    if after:
        show_change(before, after)
    if again.result.path:
        say(f"log {again.result.path}")
    if again.result.outcome.kind == INVALID:
        return INVALID_RUN
    if any(not verdict.holds for verdict in after.values()):
        return BROKEN
    return 0 if differs or again.verdict != "different" else 1


def _asked(log: "Log", overrides: Sequence[str]) -> tuple[bool, float, float]:
    """Whether it differs from what was flown, its duration, s, and its computing time, s."""
    from heli_twin.experiment.text import changed
    from heli_twin.logbook import flown_experiment
    from heli_twin.reanalysis.effort import flight_effort

    if log.ships:
        from heli_twin.experiment.several_text import changed_several
        from heli_twin.several.fly import flown_several

        together = flown_several(log)
        several = changed_several(together, overrides)
        fleet = list(several.fleet().values())
        return several != together, fleet[0].duration, sum(map(flight_effort, fleet))
    flown = flown_experiment(log)
    experiment = changed(flown, overrides)
    return experiment != flown, experiment.duration, flight_effort(experiment)


def judge(again: "Refly") -> None:
    """Print whether the second flight is the first."""
    from heli_twin.logbook import physics_notice
    from heli_twin.reanalysis.refly import POSITION_TOLERANCE_M, YAW_TOLERANCE_RAD, is_beginning

    log, result = again.logged, again.result
    if again.difference is None:
        count = sum(len(topic.times) for topic in log.messages.values())
        end = max((topic.times[-1] for topic in log.messages.values() if len(topic.times)), default=0)
        part = f"{1e-9 * end:g} s"
        if is_beginning(log):
            kind = "recovered log" if log.ending.recovered else "log of the invalid run"
            part = f"as far as the {kind} goes, {1e-9 * end:.2f} s"
        digest = "" if is_beginning(log) else f", digest {result.flight_digest[:16]}"
        print(f"identical: {count} messages, {part}{digest}")
    else:
        topic, time, field, ours, theirs = again.difference
        say(f"{again.verdict}: first at {1e-9 * time:.3f} s on {topic}, {field}")
        numbers = isinstance(ours, int | float) and isinstance(theirs, int | float)
        apart = f", {theirs - ours:+.3g}" if numbers else ""
        print(f"  logged      {clean(repr(ours))}\n  flown again {clean(repr(theirs))}{apart}")
        say(
            f"  the helicopters were at most {1000 * again.position_deviation:.3g} mm and"
            f" {57.29578 * again.yaw_deviation:.3g} deg apart"
            f" ({log.outcome}, {result.outcome.kind} again);"
            f" other hosts and builds may differ by {1000 * POSITION_TOLERANCE_M:g} mm and"
            f" {57.29578 * YAW_TOLERANCE_RAD:g} deg"
        )
    for key, (then, now) in again.platforms.items():
        print(f"  {clean(key)}: logged {clean(then) or 'none'}, now {clean(now) or 'none'}")
    if again.difference is not None and not again.platforms and not physics_notice(log):
        host = ", ".join(clean(log.metadata.get(key, "unknown")) for key in ("cpu", "platform", "git_commit"))
        print(
            f"  host and build are the same as far as the log tells ({host}): the log was changed, the program since"
            " that commit, or the vector instructions that the libraries use"
        )


def show_change(before: "dict[str, Verdict]", after: "dict[str, Verdict]") -> None:
    """Print how the verdict on each requirement changed."""
    from heli_twin.reporting.terminal_tables import print_table

    rows = [(clean(name, 60), *_change(before[name], now)) for name, now in after.items()]
    print_table(("requirement", "logged", "flown again", "change", "tightest at"), rows, "requirements")
    broken = [name for name, now in after.items() if not now.holds]
    mended = [name for name in after if name not in broken and not before[name].holds]
    new = [name for name in broken if before[name].holds]
    say(f"{len(broken)} of {len(after)} broken: {', '.join(broken)}" if broken else f"all {len(after)} hold")
    for names, words in ((new, "broken now and not before"), (mended, "broken before and not now")):
        if names:
            say(f"{words}: {', '.join(names)}")


def _change(before: "Verdict", now: "Verdict") -> tuple[str, str, str, str]:
    """Both verdicts, the change of the margin in the unit of the formula, and when they are tightest."""
    from heli_twin.requirements.judge import margin_change

    def moment(verdict: "Verdict") -> str:
        return "-" if verdict.tightest_at is None else f"{verdict.tightest_at:.2f} s"

    times = dict.fromkeys((moment(before), moment(now)))
    return before.told, now.told, margin_change(before, now), " / ".join(times)


def compare(again: "Refly") -> None:
    """Print both results."""
    from heli_twin.metrics.flat import flat
    from heli_twin.reporting.terminal_tables import metric_text, print_table
    from heli_twin.reporting.words import metric

    logged, now = flat(_metrics(again.logged)), flat(_metrics(again.result.log))
    rows: list[Sequence[str]] = []
    for key in (*now, *(key for key in logged if key not in now)):
        a, b = logged.get(key), now.get(key)
        change = ""
        if isinstance(a, int | float) and isinstance(b, int | float):
            change = metric_text(key, b - a, signed=True)
        rows.append((metric(key).name, metric_text(key, a), metric_text(key, b), change))
    print_table(("", "logged", "flown again", "difference"), rows, f"with {' '.join(again.overrides)}")
    if not again.logged.ships:
        print("errors against the truth")


def _metrics(log: "Log") -> dict[str, Any]:
    if not log.ships:
        from heli_twin.metrics.tracking import metrics

        return metrics(log)
    from heli_twin.metrics.several import several_metrics
    from heli_twin.several.fly import flown_several, wishes_of

    return several_metrics(log, wishes_of(flown_several(log)))
