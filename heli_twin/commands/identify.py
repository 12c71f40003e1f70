"""`heli-twin identify`: gains and damping of the helicopter from flight logs."""

import json
from argparse import ArgumentParser, Namespace, _SubParsersAction
from pathlib import Path
from typing import TYPE_CHECKING

from heli_twin.commands import command, file_path, progress_bar, say
from heli_twin.errors import HeliTwinError
from heli_twin.whole_file import write_whole

if TYPE_CHECKING:
    from heli_twin.identification.identify import Identified


def add(subparsers: "_SubParsersAction[ArgumentParser]") -> None:
    """Add the command."""
    parser = command(
        subparsers,
        "identify",
        run,
        "identify the model's parameters from flight logs",
        "Fit b and k of every axis to flight logs by least squares, with 95 % intervals, or say in one sentence what\n"
        "the logs lack. Without logs, doublets are flown first (six flights in the plane, two in height and heading).\n"
        "Only what a real lab records is read: the cameras' poses and the commands that were sent.",
        "  heli-twin identify\n"
        "  heli-twin identify logs/monday.mcap logs/tuesday.mcap --json\n"
        "  heli-twin identify plant.mass=0.031 --save model.toml\n"
        "  heli-twin fly model.toml                              # fly on what was identified\n"
        "  heli-twin fly ideal controller.model=model.toml       # the same in another experiment\n"
        "  heli-twin identify ideal --out logs/identification    # residual plots, model.toml and logs go there",
    )
    parser.add_argument(
        "what",
        nargs="*",
        default=[],
        metavar="RUN.mcap | PRESET | EXPERIMENT.toml | path.to.field=value",
        help="logs to use; or, as for `heli-twin fly`, the lab in which to fly doublets (default lab)",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write residual plots (SVG), model.toml and new logs here"
    )
    parser.add_argument("--save", type=file_path, metavar="FILE.toml", help="write the model for `heli-twin fly` here")
    parser.add_argument("--json", action="store_true", help="print the result as JSON, for programs")


def run(parsed: Namespace) -> int:
    """Identify, print, save."""
    from heli_twin.identification.identify import identify
    from heli_twin.recording import read_log

    words: list[str] = parsed.what
    logs = [Path(word) for word in words if word.endswith(".mcap") and "=" not in word]
    if logs and len(logs) < len(words):
        other = next(word for word in words if not word.endswith(".mcap") or "=" in word)
        raise HeliTwinError(f"give logs or an experiment to fly, not both: '{other}' is no .mcap file")
    logs = logs or _flown(words, parsed.out or Path("logs"))
    identified = identify((str(path), read_log(path)) for path in logs)
    saved = _save(identified, parsed.out, parsed.save)
    if parsed.json:
        print(json.dumps(identified.as_json() | {"files": [str(path) for path in saved]}, indent=2, allow_nan=False))
    else:
        show(identified, saved)
    return 0


def _flown(words: list[str], folder: Path) -> list[Path]:
    from heli_twin.experiment.text import load
    from heli_twin.identification.flights import experiments, fly_them

    source = words[0] if words and "=" not in words[0] else None
    flights = experiments(load(source, words[source is not None :]))
    with progress_bar() as bar:
        task = bar.add_task("flying doublets", total=len(flights))
        return fly_them(flights, folder, lambda: bar.advance(task))


def _save(identified: "Identified", out: Path | None, model: Path | None) -> list[Path]:
    """Write what was asked for; returns the files."""
    saved: list[Path] = []
    try:
        for path in filter(None, (model, out / "model.toml" if out else None)):
            write_whole(path, identified.as_toml().encode())
            saved.append(path)
        if out:
            from heli_twin.identification.figure import residual_figures
            from heli_twin.reporting.svg import write_svg

            for figure in residual_figures(identified):
                write_svg(figure, out / f"{figure.name}.svg")
                saved.append(out / f"{figure.name}.svg")
    except OSError as error:
        raise HeliTwinError(f"cannot write {error.filename}: {error.strerror}") from None
    return saved


def show(identified: "Identified", saved: list[Path]) -> None:
    """Print a result for a person."""
    from rich.console import Console
    from rich.table import Table

    from controllers.model import Model

    paper = Model()
    title = f"identified from {identified.seconds:.0f} s of {len(identified.logs)} flights"
    table = Table(title=title, title_justify="left")
    for column in ("", "value", "95 % interval", "paper (27)", "unit"):
        table.add_column(column, justify="left" if column in ("", "unit") else "right")
    for name, p in identified.parameters.items():
        unit = "1/s" if name.startswith("k") else "rad/s²" if name == "b_yaw" else "m/s²"
        table.add_row(name, f"{p.value:.4g}", f"{p.low:.4g} to {p.high:.4g}", f"{getattr(paper, name):g}", unit)
    Console().print(table)
    for axis, fit in identified.fits.items():
        say(
            f"{axis}: {100 * fit.explained:.1f} % of the acceleration explained, "
            f"commands act {1e3 * fit.delay.value:.0f} ms late"
        )
    for path in saved:
        say(f"wrote {path}")
