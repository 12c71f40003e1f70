"""What the commands do differently for several helicopters."""

import json
import sys
from argparse import Namespace
from typing import TYPE_CHECKING, Any

from heli_twin.commands import progress_bar, say
from heli_twin.commands.judge import BROKEN, verdicts_on
from heli_twin.commands.judge import show as show_verdicts
from heli_twin.errors import HeliTwinError
from heli_twin.terminal_text import pasteable

if TYPE_CHECKING:
    from heli_twin.experiment.several import Several
    from heli_twin.requirements import Requirement
    from heli_twin.several.fly import SeveralResult

INVALID_RUN = 3
"""Exit code: the process of a control law failed."""


def fly_together(parsed: Namespace, source: str, overrides: list[str], requirements: "tuple[Requirement, ...]") -> int:
    """Fly several helicopters; the exit code is that of `heli-twin fly`."""
    from heli_twin.experiment.several_text import load_several
    from heli_twin.several.fly import fly_several

    if parsed.embed_source:
        raise HeliTwinError("--embed-source is for one helicopter: keep the files of your own classes beside the log")
    several = load_several(source, overrides)
    where = _destination(parsed.rerun)
    duration = next(iter(several.fleet().values())).duration
    with progress_bar() as bar:
        task = bar.add_task(f"flying {len(several.fleet())}, s", total=duration)
        result = fly_several(
            several,
            log_dir=None if parsed.no_log else parsed.log_dir,
            progress=lambda t: bar.update(task, completed=t),
        )
    if where is not None:
        from heli_twin.viewing.show import ShownShips

        ShownShips(result.log).show(where)
    warn_late(several)
    return _tell(parsed, result, requirements)


def warn_late(several: "Several") -> None:
    """Say that planners wait for messages that come after the next one's turn."""
    between = getattr(several.coordination, "between_turns", None)
    delay, ships = several.network.delay, len(several.fleet())
    if between and delay > between(ships):
        print(
            f"heli-twin: network.delay = {delay:g} s is more than the {between(ships):g} s between the turns of {ships}"
            f" planners, who have not heard the newest plan when they plan and mostly stay where they are:"
            f" write coordination.hearing={1.2 * delay:.3g}",
            file=sys.stderr,
        )


def _destination(rerun: str | None) -> Any:
    """Read where the pictures go, before the flight; None for no pictures."""
    if rerun is None:
        return None
    from heli_twin.viewing.show import destination

    return destination(rerun)


def _tell(parsed: Namespace, result: "SeveralResult", requirements: "tuple[Requirement, ...]") -> int:
    from heli_twin.flight import INTACT, INVALID

    summary = result.summary()
    verdicts = verdicts_on(requirements, result)
    if verdicts:
        summary["requirements"] = {name: verdict.plain() for name, verdict in verdicts.items()}
    if parsed.json:
        print(json.dumps(summary, indent=2, allow_nan=False))
    else:
        show(summary)
        if verdicts:
            show_verdicts(verdicts)
    if result.outcome.kind == INVALID:
        return INVALID_RUN
    if any(not verdict.holds for verdict in verdicts.values()):
        return BROKEN
    return 0 if result.outcome.kind in INTACT and not result.log_trouble else 1


def show(summary: dict[str, Any]) -> None:
    """Print how several helicopters flew."""
    say(f"{summary['outcome']}: {summary['outcome_text']}")
    show_ships(summary)
    show_distances(summary)
    digest = summary["flight_digest"]
    say(f"{summary['real_time_factor']:.1f} times real time" + (f", digest {digest[:16]}" if digest else ""))
    if summary["log"]:
        first = f"{summary['log']}#{next(iter(summary['ships']))}"
        say(f"log {summary['log']}; each helicopter in it is a flight: {pasteable('heli-twin', 'info', first)}")


def show_ships(summary: dict[str, Any]) -> None:
    """Print a row for each helicopter."""
    from heli_twin.reporting.terminal_tables import MISSING, length, milliseconds, print_table

    def seconds(value: float | None) -> str:
        return MISSING if value is None else f"{value:.2f} s"

    rows = [
        (
            name,
            ship["outcome"],
            "yes" if ship["arrived"] else "no",
            seconds(ship["time_to_goal"]),
            seconds(ship["stuck"]),
            *(length(ship["rmse"][axis]) for axis in "xyz"),
            milliseconds(ship["control_step_ms"]["p99"]),
        )
        for name, ship in summary["ships"].items()
    ]
    header = ("", "outcome", "arrived", "at its goal", "stuck", "rms x", "rms y", "rms z", "step 99 %")
    print_table(header, rows, "each helicopter; errors against the plans that it flew", left=(0, 1))


def show_distances(summary: dict[str, Any]) -> None:
    """Print how near they came to each other, and what the planners did."""
    from heli_twin.reporting.terminal_tables import milliseconds

    for name, where, what in (
        ("least_distance_in_plane", "nearest", "least distance in the plane"),
        ("least_planned", "nearest_planned", "of what they were committed to"),
    ):
        if summary[name] is not None:
            at = summary[where]
            say(f"{what}: {summary[name]:.3f} m, {' and '.join(at['ships'])} at {at['time']:.2f} s")
    if summary["turns"]:
        say(
            f"{summary['turns']} turns of planners, {summary['refused_plans']} new plans refused,"
            f" {summary['messages']} messages; a turn takes {milliseconds(summary['planning_ms']['p50'])},"
            f" 99 % {milliseconds(summary['planning_ms']['p99'])}"
        )
