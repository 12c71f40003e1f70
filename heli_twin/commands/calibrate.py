"""`heli-twin calibrate`: the twin of one particular helicopter, from logs of its flights."""

import json
from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heli_twin.commands import command, file_path, progress_bar, say
from heli_twin.errors import HeliTwinError
from heli_twin.terminal_text import pasteable
from heli_twin.whole_file import write_whole

if TYPE_CHECKING:
    from heli_twin.calibration.calibrate import Calibrated
    from heli_twin.experiment import Experiment

EXPECTED_ITERATIONS = 14
"""Of all stages of a fit, for the progress bar."""


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "calibrate",
        run,
        "make the twin of a real helicopter from logs of its flights",
        "Fit the twin's parameters to flight logs, with 95 % intervals, and say which of them the flights leave open.\n"
        "Only what a real lab records is read: the cameras' poses and the commands that were sent. Without logs, the\n"
        "calibration flights are flown first in the given lab: doublets in the plane and in height, then of all axes,\n"
        "both with a multisine on all inputs, and a circle to check the result on.",
        "  heli-twin calibrate                                    # fly the lab's helicopter, and calibrate on it\n"
        "  heli-twin calibrate --plan                             # what the flights would tell, before anyone flies\n"
        "  heli-twin calibrate --card                             # the flights as text for the people in a lab\n"
        "  heli-twin calibrate monday.mcap tuesday.mcap --mass 0.0291 --save calibration.toml\n"
        "  heli-twin fly calibration.toml                         # fly on what was calibrated\n"
        "  heli-twin calibrate monday.mcap radio.frame_period=0.011 --out logs/calibration",
    )
    parser.add_argument(
        "what",
        nargs="*",
        default=[],
        metavar="RUN.mcap | PRESET | EXPERIMENT.toml | path.to.field=value",
        help="logs to use; and what is believed of helicopter and radio, as for `heli-twin fly` (default lab)",
    )
    parser.add_argument("--mass", type=float, metavar="KG", help="the helicopter's weight; flights cannot tell it")
    parser.add_argument(
        "--save", type=file_path, metavar="FILE.toml", help="write the calibrated helicopter for `heli-twin fly` here"
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="write the page, calibration.toml, posterior, ensemble and new logs here",
    )
    parser.add_argument("--plan", action="store_true", help="say what flights would tell, and which helps most next")
    parser.add_argument("--card", action="store_true", help="print the calibration flights for a real lab")
    parser.add_argument(
        "--anyway", action="store_true", help="go on with a fit that did not converge, or a form that is wrong"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON, for programs")


def run(parsed: Namespace) -> int:
    """Calibrate, print, save."""
    from heli_twin.experiment.text import load

    words: list[str] = parsed.what
    logs = [Path(word) for word in words if word.endswith(".mcap") and "=" not in word]
    rest = [word for word in words if not word.endswith(".mcap") or "=" in word]
    source = next((word for word in rest if "=" not in word), None)
    base = load(source, [word for word in rest if word != source])
    if parsed.mass is not None and not 0.01 <= parsed.mass <= 0.1:
        raise HeliTwinError(
            f"--mass {parsed.mass:g} kg: a helicopter of 0.01 to 0.1 kg can be simulated; 0.028 is usual"
        )
    if parsed.card:
        return _card(base)
    if parsed.plan:
        return _plan(base, logs, as_json=parsed.json)
    folder = parsed.out or Path("logs")
    try:
        calibrated = _calibrated(base, logs, folder, parsed)
    except HeliTwinError as error:
        _save_picture(error, parsed.out)
        raise
    files = _save(calibrated, parsed, pasteable("heli-twin", "calibrate", *words))
    if parsed.json:
        print(json.dumps(calibrated.as_json() | {"files": [str(path) for path in files]}, indent=2, allow_nan=False))
    else:
        show(calibrated, files)
    return 0


def _card(base: "Experiment") -> int:
    from heli_twin.calibration.flights import card, planned

    for flight in planned(base):
        for line in card(flight).splitlines():
            say(line)
        print()
    return 0


def _save_picture(error: HeliTwinError, out: Path | None) -> None:
    """Draw the reason of a refusal into the folder for results."""
    figure = getattr(error, "figure", None)
    if figure and out:
        from heli_twin.reporting.svg import write_svg

        out.mkdir(parents=True, exist_ok=True)
        write_svg(figure, out / f"refused-{figure.name}.svg")


def _calibrated(base: "Experiment", logs: list[Path], folder: Path, parsed: Namespace) -> "Calibrated":
    from heli_twin.calibration.calibrate import calibrate, flights_of
    from heli_twin.calibration.flights import FITTED, fly_them, planned

    with progress_bar() as bar:
        if not logs:
            flights = planned(base)
            task = bar.add_task("flying", total=len(flights))
            flown = fly_them(flights, folder, lambda: bar.advance(task))
            logs = flown[: len(FITTED)]
        task = bar.add_task("fitting", total=EXPECTED_ITERATIONS)
        read = [_read(path) for path in logs]
        return calibrate(
            flights_of(read, base), base, mass=parsed.mass, anyway=parsed.anyway, progress=lambda: bar.advance(task)
        )


def _read(path: Path) -> tuple[str, Any, int | None]:
    """Name, log, and the seed if it is a flight of the twin: the only thing that is read of its experiment."""
    from heli_twin.recording import read_log

    log = read_log(path)
    seed = None
    if log.origin == "flight":
        try:
            seed = int(json.loads(log.experiment).get("seed", 0))
        except (ValueError, AttributeError):
            seed = None
    return str(path), log, seed


def _save(calibrated: "Calibrated", parsed: Namespace, command_line: str) -> list[Path]:
    from heli_twin.calibration.output import as_toml
    from heli_twin.calibration.page import write_page
    from heli_twin.calibration.posterior import ensemble, posterior

    files: list[Path] = []
    try:
        for path in filter(None, (parsed.save, parsed.out / "calibration.toml" if parsed.out else None)):
            write_whole(path, as_toml(calibrated, command_line).encode())
            files.append(path)
        if parsed.out:
            texts = {
                "posterior.json": json.dumps(posterior(calibrated), indent=1, allow_nan=False),
                "ensemble.toml": ensemble(calibrated),
            }
            for name, text in texts.items():
                write_whole(parsed.out / name, text.encode())
                files.append(parsed.out / name)
            write_page(calibrated, parsed.out / "calibration.html")
            files.append(parsed.out / "calibration.html")
    except OSError as error:
        raise HeliTwinError(f"cannot write {error.filename}: {error.strerror}") from None
    return files


def _plan(base: "Experiment", logs: list[Path], *, as_json: bool) -> int:
    from heli_twin.calibration import planning
    from heli_twin.calibration.calibrate import flights_of
    from heli_twin.calibration.flights import planned
    from heli_twin.mission import fly

    with progress_bar() as bar:
        flights = planned(base)
        task = bar.add_task("flying and weighing", total=len(flights) + len(logs))
        information: dict[str, Any] = {}
        for flight in flights:
            log = fly(flight.experiment, log_dir=None).log
            (data,) = flights_of([(flight.name, log, None)], base)
            information[flight.name] = planning.information(data, base)
            bar.advance(task)
        known: list[Any] = []
        for data in flights_of([_read(path) for path in logs], base) if logs else []:
            known.append(planning.information(data, base))
            bar.advance(task)
    so_far: Any = sum(known, 0.0 * next(iter(information.values())))
    alone = {name: planning.bounds([*known, each], base) for name, each in information.items()}
    alone["both"] = planning.bounds([*known, *list(information.values())[:2]], base)
    gains = {name: planning.gain(so_far, each, base) for name, each in information.items()}
    if as_json:
        print(json.dumps(planning.as_json(alone, gains), indent=2, allow_nan=False))
        return 0
    _show_plan(alone, gains, has_logs=bool(known))
    return 0


def _show_plan(alone: dict[str, Any], gains: dict[str, float], *, has_logs: bool) -> None:
    from rich.console import Console
    from rich.table import Table

    # All columns fit in 80 characters.
    title = "standard deviation that a flight would leave (Cramer-Rao)"
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for column in ("", "unit", *(name.removeprefix("calibrate_") for name in alone)):
        table.add_column(column, justify="left" if column in ("", "unit") else "right", no_wrap=True)
    for row in zip(*alone.values(), strict=True):
        cells = [f"{100.0 * b.deviation if b.is_relative else b.deviation:.2g}" for b in row]
        unit = "%" if row[0].is_relative else row[0].unit
        table.add_row(row[0].name, unit, *(c if b.told else f"({c})" for c, b in zip(cells, row, strict=True)))
    Console().print(table)
    say("in brackets: not told, the prior speaks")
    best = max(gains, key=lambda name: gains[name])
    again = "after these logs, " if has_logs else ""
    say(f"{again}the flight that would help most next: {best}; `heli-twin calibrate --card` prints it for a lab")


def show(calibrated: "Calibrated", files: list[Path]) -> None:
    """Print a result for a person."""
    from rich.console import Console
    from rich.table import Table

    from heli_twin.calibration.calibrate import EFFECTS

    title = f"calibrated from {calibrated.seconds:.0f} s of {len(calibrated.logs)} flights"
    # All columns fit in 80 characters.
    table = Table(title=title, title_justify="left", box=None, pad_edge=False, padding=(0, 1, 0, 0))
    for column in ("", "value", "95 % interval", "unit", "told"):
        is_number = column in ("value", "95 % interval")
        table.add_column(column, justify="right" if is_number else "left", no_wrap=True)
    for name, k in calibrated.parameters.items():
        interval = f"{k.low:.4g} to {k.high:.4g}"
        table.add_row(name, f"{k.value:.4g}", interval, k.unit, "" if k.told else "no")
    Console().print(table)
    if not all(k.told for k in calibrated.parameters.values()):
        say("told: no where the prior speaks, since the flights say too little")
    left_out = [name for name in EFFECTS if name not in calibrated.kept]
    say(f"plant effects that it has: {', '.join(calibrated.kept) or 'none'}; left out: {', '.join(left_out) or 'none'}")
    channel, statistic, ratio = calibrated.structure.worst
    verdict = "the form of the twin explains these flights" if ratio <= 1.0 else "the form of the twin is wrong"
    say(f"{verdict}: worst residual {channel}, {statistic}, {ratio:.2f} of its limit")
    for remark in calibrated.remarks:
        say(remark)
    say(f"mass {calibrated.mass:g} kg is taken as given: flights tell only ratios to it")
    for path in files:
        say(f"wrote {path}")
