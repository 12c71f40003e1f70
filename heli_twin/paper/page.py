"""One page that needs no network: the verdicts, the figures, and the command behind every curve."""

import html
from base64 import b64encode
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from heli_twin.metrics import SETTLING
from heli_twin.paper.claims import CM
from heli_twin.paper.comparison import DEGREES
from heli_twin.paper.flights import CASES, Flights
from heli_twin.paper.verdicts import Claim
from heli_twin.studies.report.figure import Figure, Table
from heli_twin.studies.report.page import STYLE
from heli_twin.studies.report.words import number


class Section(NamedTuple):
    """A part of the page."""

    title: str
    body: str


def claims_section(title: str, sentence: str, claims: Sequence[Claim]) -> Section:
    """The verdicts."""
    head = "".join(f"<th>{cell}</th>" for cell in ("claim", "paper", "ours, with 95 % interval", "verdict", "why"))
    rows = "".join(
        f"<tr><td>{_(c.claim)}</td><td>{_(c.paper)}</td><td>{_(c.ours)}</td>"
        f'<td class="{c.verdict.replace(" ", "-")}">{_(c.verdict)}</td><td>{_(c.why)}</td></tr>'
        for c in claims
    )
    return Section(title, f"<p>{_(sentence)}</p>{_rows(head, rows)}")


def table_section(table: Table) -> Section:
    """A table."""
    head = "".join(f"<th>{_(cell)}</th>" for cell in table.header)
    rows = "".join(f"<tr>{''.join(_cell(table, i, cell) for i, cell in enumerate(row))}</tr>" for row in table.rows)
    return Section(table.title, f"<p>{_(table.sentence)}</p>{_rows(head, rows)}")


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
        f"<tr><td>{_(CASES[case].label)}</td><td>replay <code>heli-twin replay {_(str(log))}</code></td>"
        f"<td>fly again <code>heli-twin refly {_(str(log))}</code></td></tr>"
    )


def flown_table(flights: Flights, seeds: int, duration: float) -> Table:
    """Everything that was flown, its errors, and the command that flies the first flight of each."""
    rows: list[list[str]] = []
    for name, found in flights.rows.items():
        errors = [_short(CM * flights.rms(name, axis)) for axis in "xyz"] + [_short(DEGREES * flights.rms(name, "yaw"))]
        completed = f"{len(found) - flights.failed(name)} of {len(found)}"
        rows.append([CASES[name].label, completed, *errors, CASES[name].command(duration)])
    sentence = (
        f"Seeds 0 to {seeds - 1}, {duration:g} s each; rms errors against the truth over all flights of a kind, "
        f"the first {SETTLING:g} s of each left out."
    )
    header = ["", "completed", "x, cm", "y, cm", "z, cm", "yaw, deg", "command of the first flight"]
    return Table("What was flown", sentence, header, rows, codes=(6,))


def _short(value: float) -> str:
    """What is too small to matter is nothing."""
    return number(round(value, 4))


def page(question: str, sections: Sequence[Section]) -> str:
    """The whole page."""
    return TEMPLATE.format(
        style=STYLE + MORE_STYLE,
        question=_(question),
        contents=" \u00b7 ".join(f'<a href="#{_anchor(s.title)}">{_(s.title)}</a>' for s in sections),
        body="\n".join(_sections(sections)),
    )


def _sections(sections: Sequence[Section]) -> Iterator[str]:
    for section in sections:
        yield f'<section id="{_anchor(section.title)}"><h2>{_(section.title)}</h2>{section.body}</section>'


def _rows(head: str, rows: str) -> str:
    return f'<div class="table"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


def _cell(table: Table, column: int, text: str) -> str:
    return f"<td><code>{_(text)}</code></td>" if column in table.codes else f"<td>{_(text)}</td>"


def _anchor(title: str) -> str:
    return "-".join("".join(c if c.isalnum() else " " for c in title.lower()).split())


def _(text: str) -> str:
    return html.escape(text)


MORE_STYLE = """
img { max-width: 100%; height: auto; }
td.reproduced, td.not-reproduced, td.not-comparable { white-space: nowrap; font-weight: 600; }
td.reproduced { color: #00674B; } td.not-reproduced { color: #B04A00; } td.not-comparable { color: #555; }
table.commands { font-size: .8rem; } table.commands td { border: 0; padding: .1rem .8rem .1rem 0; }
"""

TEMPLATE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>Fast Model Predictive Control of Miniature Helicopters, reproduced</title>
<style>{style}</style>
</head>
<body>
<h1>Fast Model Predictive Control of Miniature Helicopters, reproduced</h1>
<p>{question}</p>
<nav>{contents}</nav>
{body}
</body>
</html>
"""
