"""`heli-twin validate`: a twin beside a flight that it was not fitted to."""

import json
from argparse import ArgumentParser, Namespace, _SubParsersAction
from typing import TYPE_CHECKING, Any

from heli_twin.commands import command, file_path, progress_bar, say
from heli_twin.errors import HeliTwinError

if TYPE_CHECKING:
    from heli_twin.validation.validate import Validation

ATTACHED = "validation.json"
"""Name of the attachment."""


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "validate",
        run,
        "judge a calibrated twin on a flight that it was not fitted to",
        "Predict a flight with a twin, and say whether the twin is that helicopter. In open loop, every second, the\n"
        "state is taken from one second of poses, and the next two are predicted from the sent commands alone. In\n"
        "closed loop, the twin is flown with the plan and the controller of the log. The uncalibrated twin and, for a\n"
        "flight of the twin itself, the true parameters stand beside it. Only poses, sent commands and plan are read;\n"
        "a constant push, the markers' place and tilt and the phase of the radio's frames are fitted to the log.\n"
        "Exit code: 0 the twin agrees with the flight, 1 it differs, 2 a mistake in what was asked for.",
        "  heli-twin validate check.mcap calibration.toml\n"
        "  heli-twin validate check.mcap calibration.toml --json | jq .verdict\n"
        "  heli-twin validate check.mcap calibration.toml --attach   # keep the result and its envelope in the log\n"
        "  heli-twin validate check.mcap                             # how far off is the lab's helicopter?\n"
        "  heli-twin validate check.mcap lab plant.mass=0.031 --flights 0",
    )
    parser.add_argument("log", type=file_path, metavar="RUN.mcap", help="a flight that was not used for fitting")
    parser.add_argument(
        "what",
        nargs="*",
        default=[],
        metavar="calibration.toml | PRESET | path.to.field=value",
        help="the twin, as for `heli-twin fly` (default lab)",
    )
    parser.add_argument(
        "--prior", default="lab", metavar="PRESET | FILE.toml", help="the uncalibrated twin beside it (default lab)"
    )
    parser.add_argument("--flights", type=int, default=4, metavar="N", help="of each twin in closed loop, 0 to 50")
    parser.add_argument("--attach", action="store_true", help="put the result into the log, outside of its digest")
    parser.add_argument("--json", action="store_true", help="print the result as JSON, for programs")


def run(parsed: Namespace) -> int:
    """Validate, print, attach."""
    if not 0 <= parsed.flights <= 50:
        raise HeliTwinError(f"--flights {parsed.flights}: give 0 to 50; 4 is usual")
    result = _validated(parsed)
    text = json.dumps(result.as_json(), indent=2, allow_nan=False)
    if parsed.json:
        print(text)
    else:
        show(result)
    if parsed.attach:
        from heli_twin.recording import Attachment
        from heli_twin.recording.attach import attach

        attach(parsed.log, Attachment(ATTACHED, "application/json", text.encode()))
        if not parsed.json:
            say(f"put {ATTACHED} into {parsed.log}")
    return 0 if result.verdict == "agrees" else 1


def _validated(parsed: Namespace) -> "Validation":
    from dataclasses import replace

    from heli_twin.experiment.envelope import envelope_in
    from heli_twin.experiment.text import load
    from heli_twin.recording import read_log
    from heli_twin.validation.twins import noise_in
    from heli_twin.validation.validate import Effort, twins_of, validate

    log = read_log(parsed.log)
    source = next((word for word in parsed.what if "=" not in word), None)
    experiment = load(source, [word for word in parsed.what if word != source])
    twins = twins_of(log, experiment, noise_in(source, experiment), load(parsed.prior))
    envelope = envelope_in(source)
    with progress_bar() as bar:
        task = bar.add_task("predicting and flying", total=len(twins) * (1 + parsed.flights))
        result = validate(log, str(parsed.log), twins, Effort(parsed.flights), lambda: bar.advance(task))
    return replace(result, left=tuple(envelope.left_by(result.envelope)) if envelope else ())


def show(result: "Validation") -> None:
    """Print a result for a person."""
    from rich.console import Console

    console = Console()
    console.print(_error_table(result))
    console.print(_measure_table(result))
    if any(not isinstance(side.loop, str) for side in result.sides):
        console.print(_loop_table(result))
    else:
        say(f"closed loop: {result.judged.loop}")
    channel, statistic, ratio = result.judged.whiteness.worst
    say(f"whiteness of the residual, worst of all channels: {channel}, {statistic}, {ratio:.2f} of its limit")
    say(f"the flight covers: {_covers(result)}")
    for remark in result.remarks:
        say(remark)
    say("the twin agrees with the flight" if result.verdict == "agrees" else "the twin differs from the helicopter:")
    for reason in result.reasons:
        say(f"  {reason}")


def _table(title: str, *columns: str) -> Any:
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for column in ("", *columns):
        table.add_column(column, justify="right" if column else "left")
    return table


def _error_table(result: "Validation") -> Any:
    from heli_twin.calibration.data import CHANNELS
    from heli_twin.validation.validate import shown

    table = _table("open loop: rms error of the prediction", *CHANNELS)
    for horizon, judged in result.judged.open_loop.items():
        for side in result.sides:
            cells = (shown(channel, a.rms) for channel, a in side.open_loop[horizon].items())
            table.add_row(f"{horizon:g} s, {side.name}", *cells)
        table.add_row("  by gusts and cameras alone", *(shown(channel, a.expected) for channel, a in judged.items()))
        table.add_section()
    return table


def _measure_table(result: "Validation") -> Any:
    from heli_twin.calibration.data import CHANNELS

    table = _table(f"open loop, {result.judged.name}: measures", *CHANNELS)
    for horizon, each in result.judged.open_loop.items():
        table.add_row(f"{horizon:g} s, NRMSE", *(f"{a.nrmse:.3f}" for a in each.values()))
        table.add_row("  Theil's U", *(f"{a.theil:.3f}" for a in each.values()))
        table.add_row("  bias, cm or deg", *(f"{_factor(c) * a.bias:.2f}" for c, a in each.items()))
        table.add_row("  its 95 % interval", *(_interval(c, a.bias_low, a.bias_high) for c, a in each.items()))
        table.add_section()
    return table


def _factor(channel: str) -> float:
    """To cm or degrees."""
    return 100.0 if channel in ("x", "y", "z") else 57.29578


def _interval(channel: str, low: float, high: float) -> str:
    return f"{_factor(channel) * low:.2f} to {_factor(channel) * high:.2f}"


def _loop_table(result: "Validation") -> Any:
    from heli_twin.validation.validate import shown

    table = _table("closed loop: rms distance from the plan, by the cameras", "x", "y", "z", "yaw")
    flown = next(side.loop for side in result.sides if not isinstance(side.loop, str))
    table.add_row("flown", *(shown(axis, loop.flown) for axis, loop in flown.items()))
    for side in result.sides:
        if isinstance(side.loop, str):
            table.add_row(side.name, side.loop)
            continue
        table.add_row(side.name, *(shown(axis, loop.twin) for axis, loop in side.loop.items()))
    return table


def _covers(result: "Validation") -> str:
    e = result.envelope
    assert e.height
    return (
        f"{result.seconds:.0f} s, speed up to {e.speed:.2f} m/s, height {e.height[0]:.2f} to {e.height[1]:.2f} m, tilt"
        f" up to {57.29578 * (e.tilt or 0.0):.0f} deg"
    )
