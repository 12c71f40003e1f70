"""One page that needs no network: the verdicts, the figures, and the command behind every curve."""

import html
from base64 import b64encode
from collections.abc import Sequence
from pathlib import Path

from heli_twin.metrics.tracking import SETTLING_S
from heli_twin.paper.cases import CASES
from heli_twin.paper.claims import CM
from heli_twin.paper.comparison import DEGREES
from heli_twin.paper.flights import Flights
from heli_twin.paper.verdicts import Claim
from heli_twin.reporting.figure import Figure, Table
from heli_twin.reporting.html_page import Section, html_table
from heli_twin.reporting.words import number
from heli_twin.terminal_text import pasteable


def claims_section(title: str, sentence: str, claims: Sequence[Claim]) -> Section:
    """The verdicts."""
    rows = [
        [
            *(f"<td>{_(text)}</td>" for text in (c.claim, c.paper, c.ours)),
            f'<td class="{c.verdict.replace(" ", "-")}">{_(c.verdict)}</td>',
            f"<td>{_(c.why)}</td>",
        ]
        for c in claims
    ]
    header = ("claim", "paper", "ours, with 95 % interval", "verdict", "why")
    return Section(title, f"<p>{_(sentence)}</p>{html_table(header, rows)}")


def figure_section(figure: Figure, svg: Path, cases: Sequence[str] = (), flights: Flights | None = None) -> Section:
    """A figure, and for each curve what replays its flight and what flies it again."""
    data = b64encode(svg.read_bytes()).decode()
    image = f'<a href="{svg.name}"><img alt="{_(figure.title)}" src="data:image/svg+xml;base64,{data}"></a>'
    lines = "".join(_commands(flights, case) for case in cases) if flights else ""
    caption = f'<table class="commands"><tbody>{lines}</tbody></table>' if lines else ""
    return Section(figure.title, f"<p>{_(figure.sentence)}</p>{image}{caption}")


def _commands(flights: Flights, case: str) -> str:
    log = flights.path(case)
    return (
        f"<tr><td>{_(CASES[case].label)}</td><td>replay <code>{_(pasteable('heli-twin', 'replay', log))}</code></td>"
        f"<td>fly again <code>{_(pasteable('heli-twin', 'refly', log))}</code></td></tr>"
    )


def flown_table(flights: Flights, seeds: int, duration: float) -> Table:
    """Everything that was flown, its errors, and the command that flies the first flight of each."""
    rows: list[list[str]] = []
    for name, found in flights.rows.items():
        errors = [_short(CM * flights.rms(name, axis)) for axis in "xyz"] + [_short(DEGREES * flights.rms(name, "yaw"))]
        completed = f"{len(found) - flights.failed(name)} of {len(found)}"
        rows.append([CASES[name].label, completed, *errors, CASES[name].command(duration)])
    sentence = (
        f"Seeds 0 to {seeds - 1}, {duration:g} s each, fewer where fewer are counted; rms errors against the "
        "truth over all flights of a kind, "
        f"the first {SETTLING_S:g} s of each left out."
    )
    header = ["", "completed", "x, cm", "y, cm", "z, cm", "yaw, deg", "command of the first flight"]
    return Table("What was flown", sentence, header, rows, codes=(6,))


def _short(value: float) -> str:
    """A number rounded to four decimals; smaller ones are 0."""
    return number(round(value, 4))


def _(text: str) -> str:
    return html.escape(text)


STYLE = """
img { max-width: 100%; height: auto; }
td.reproduced, td.fitted, td.not-reproduced, td.not-comparable { white-space: nowrap; font-weight: 600; }
td.reproduced { color: #00674B; } td.fitted { color: #6B5200; } td.not-reproduced { color: #B04A00; }
td.not-comparable { color: #555; }
table.commands { font-size: .8rem; } table.commands td { border: 0; padding: .1rem .8rem .1rem 0; }
"""
