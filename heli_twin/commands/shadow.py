"""`heli-twin shadow`: the twin watches a helicopter and says when it has changed."""

import json
import sys
from argparse import ArgumentParser, Namespace, _SubParsersAction
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heli_twin.commands import command, progress_bar, say
from heli_twin.errors import HeliTwinError

if TYPE_CHECKING:
    from heli_twin.experiment import Experiment
    from heli_twin.validation.band import Band
    from heli_twin.validation.shadow import ShadowEvent

PIPE = "-"


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "shadow",
        run,
        "watch a flight with the twin, and say when the helicopter has changed",
        "Run the calibrated twin and its estimator along a log, or along poses and commands on a pipe, and print an\n"
        "event when what the cameras see leaves its band: a rotor, the battery, a servo, the gyro or the load has\n"
        "changed. The first six seconds of each flight tell what is normal that day. The band is such that a sound\n"
        "helicopter leaves it --rate times an hour; --quiet learns it from flights that are known to be sound.\n"
        "On a pipe, the first line is `heli_twin 1`. A line of 5 numbers is a command, as an external law answers\n"
        "it (time ns, pitch, roll, thrust, yaw), and one of 8 a pose (capture time ns, x y z in m, attitude w x y z).\n"
        "Exit code: 0 nothing has changed, 1 something has, 2 a mistake in what was asked for.",
        "  heli-twin shadow today.mcap calibration.toml\n"
        "  heli-twin shadow today.mcap calibration.toml --quiet monday.mcap --quiet tuesday.mcap --rate 0.1\n"
        "  ./my_lab | heli-twin shadow - calibration.toml --json   # one line of JSON for each event, at once\n"
        "  heli-twin shadow today.mcap --lines                     # what such a pipe looks like",
    )
    parser.add_argument("log", metavar="RUN.mcap | -", help="a log, or - for lines on the standard input")
    parser.add_argument(
        "what",
        nargs="*",
        default=[],
        metavar="calibration.toml | PRESET | path.to.field=value",
        help="the twin, as for `heli-twin fly` (default detailed: the lab's helicopter)",
    )
    parser.add_argument("--rate", type=float, default=1.0, metavar="PER_HOUR", help="false alarms an hour (default 1)")
    parser.add_argument(
        "--quiet", type=Path, action="append", default=[], metavar="LOG", help="learn the band from this sound flight"
    )
    parser.add_argument("--lines", action="store_true", help="print the log as the lines of a pipe, and watch nothing")
    parser.add_argument("--json", action="store_true", help="print each event as a line of JSON, and then a summary")


def run(parsed: Namespace) -> int:
    """Watch and print."""
    from heli_twin.validation.shadow import Alarm, from_log, watched
    from heli_twin.validation.wire import from_lines, to_lines

    if not 1e-6 <= parsed.rate <= 1000.0:
        raise HeliTwinError(f"--rate {parsed.rate:g}: give false alarms an hour, 0.000001 to 1000; 1 is usual")
    if parsed.lines:
        if parsed.log == PIPE:
            raise HeliTwinError("--lines prints a log: give a RUN.mcap in place of -")
        for line in to_lines(from_log(_read(parsed.log))):
            print(line)
        return 0
    experiment = _believed(parsed.what)
    alarm = Alarm(_band(parsed.quiet, experiment), parsed.rate)
    messages = from_lines(_standard_input()) if parsed.log == PIPE else from_log(_commanded(parsed.log))
    events: list[ShadowEvent] = []
    try:
        for seen in watched(experiment, messages):
            for event in alarm.events(seen):
                events.append(event)
                _tell(event, as_json=parsed.json)
    except KeyboardInterrupt:
        # The usual end of a watch on a pipe.
        _sum_up(events, alarm.seconds, as_json=parsed.json)
        raise
    if not alarm.seconds:
        raise HeliTwinError(f"{parsed.log} holds no poses above 0.2 m with commands: there is nothing to watch")
    _sum_up(events, alarm.seconds, as_json=parsed.json)
    return 1 if events else 0


def _believed(words: list[str]) -> "Experiment":
    """Believed parameters of the detailed law and estimator, from a calibration."""
    from heli_twin.experiment.text import load

    source = next((word for word in words if "=" not in word), "detailed")
    laws = ["controller=detailed_mpc", "estimator=detailed_kalman"]
    return load(source, [*laws, *(word for word in words if word != source)])


def _band(quiet: list[Path], experiment: "Experiment") -> "Band":
    from heli_twin.validation.band import DEFAULT, learned
    from heli_twin.validation.shadow import from_log, watched

    if not quiet:
        return DEFAULT
    with progress_bar() as bar:
        task = bar.add_task("learning from quiet flights", total=len(quiet))
        flights: list[Any] = []
        for path in quiet:
            flights.append(list(watched(experiment, from_log(_read(path)))))
            bar.advance(task)
    return learned(flights)


def _read(path: str | Path) -> Any:
    from heli_twin.recording import read_log

    return read_log(path, ("/mocap/pose", "/command/sent"))


def _commanded(path: str) -> Any:
    """A log with commands.

    Raises:
        HeliTwinError: It has none, so that nothing can be predicted.
    """
    import numpy as np

    log = _read(path)
    if not len(log.sent.time) or not np.isfinite(log.sent.u).all():
        raise HeliTwinError(
            f"{path} lacks sent commands: the twin needs all four inputs; import the recording with them"
            " (`heli-twin import take.csv --commands sent.csv`)"
        )
    return log


def _standard_input() -> Iterable[str]:
    if sys.stdin is None:
        raise HeliTwinError("the standard input is closed: pipe lines into it, or give a RUN.mcap")
    return _decoded(sys.stdin.buffer)


def _decoded(lines: Iterable[bytes]) -> Iterator[str]:
    for line in lines:
        yield line.decode("ascii", "backslashreplace")


def _tell(event: "ShadowEvent", *, as_json: bool) -> None:
    if as_json:
        print(json.dumps(event.plain(), allow_nan=False), flush=True)
    else:
        say(f"{event.time:8.2f} s  {'CHANGED' if event.event == 'left' else 'normal ':<8} {event.text}")
        sys.stdout.flush()


def _sum_up(events: "list[ShadowEvent]", seconds: float, *, as_json: bool) -> None:
    left = [event for event in events if event.event == "left"]
    if as_json:
        first = left[0].time if left else None
        summary = {"event": "end", "time": seconds, "changes": len(left), "first": first}
        print(json.dumps(summary, allow_nan=False), flush=True)
    elif left:
        names = ", ".join(dict.fromkeys(event.statistic for event in left))
        say(f"the helicopter has changed: {names}, first at {left[0].time:.2f} s of {seconds:.1f} s watched")
    else:
        say(f"nothing has changed in {seconds:.1f} s")
