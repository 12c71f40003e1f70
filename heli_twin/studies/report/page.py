"""One page that needs no network: tables, interactive figures, and a command behind every point."""

import html
import json
from base64 import b64encode
from pathlib import Path

from heli_twin.studies.report import drawing, interactive
from heli_twin.studies.report.effort import effort, timing
from heli_twin.studies.report.fairness import fairness
from heli_twin.studies.report.figure import Figure, Table
from heli_twin.studies.report.ladder import ladder
from heli_twin.studies.report.maps import maps
from heli_twin.studies.report.margins import margins
from heli_twin.studies.report.results import Results, results_of
from heli_twin.studies.report.search import search
from heli_twin.studies.report.sensitivity import sensitivity
from heli_twin.studies.report.tables import provenance, worst
from heli_twin.studies.report.tornado import tornado
from heli_twin.studies.report.verdict import verdict

SECTIONS = (verdict, ladder, tornado, maps, margins, sensitivity, search, effort, timing, worst, fairness, provenance)
"""What a report shows, in this order; a section that does not fit the study shows nothing."""


def write_report(folder: Path) -> Path:
    """Write `report.html` and an SVG for each figure into a study's folder.

    Returns:
        The path of the page.

    Raises:
        StudyError: There are no results.
    """
    results = results_of(folder)
    parts = [part for section in SECTIONS for part in section(results)]
    figures = folder / "figures"
    figures.mkdir(exist_ok=True)
    for part in parts:
        if isinstance(part, Figure):
            drawing.write_svg(part, figures / f"{part.name}.svg")
    page = folder / "report.html"
    page.write_text(_page(results, parts, figures), encoding="utf-8")
    return page


def _page(results: Results, parts: list[Figure | Table], figures: Path) -> str:
    study = results.study
    body = "\n".join(_figure(part, figures) if isinstance(part, Figure) else _table(part) for part in parts)
    contents = " \u00b7 ".join(f'<a href="#{_anchor(part.title)}">{html.escape(part.title)}</a>' for part in parts)
    title = html.escape(study.name.replace("_", " "))
    return TEMPLATE.format(
        title=title,
        question=html.escape(study.question),
        contents=contents,
        body=body,
        plotly=interactive.library(),
        script=SCRIPT,
        style=STYLE + ONCE,
    )


def _figure(figure: Figure, folder: Path) -> str:
    """A figure twice: the interactive one for the screen, the drawn one for paper, where nothing can be clicked."""
    drawn = b64encode((folder / f"{figure.name}.svg").read_bytes()).decode()
    spec = json.dumps(interactive.spec(figure), separators=(",", ":"), allow_nan=False).replace("</", "<\\/")
    return (
        f'<section id="{_anchor(figure.title)}"><h2>{html.escape(figure.title)}</h2>'
        f"<p>{html.escape(figure.sentence)}</p>"
        f'<img alt="{html.escape(figure.title)}" src="data:image/svg+xml;base64,{drawn}">'
        f'<div class="figure"></div><script type="application/json">{spec}</script>'
        f'<p class="tools"><code class="command"></code><a href="figures/{figure.name}.svg">SVG</a></p></section>'
    )


def _table(table: Table) -> str:
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in table.header)
    rows = "".join(f"<tr>{''.join(_cell(table, i, cell) for i, cell in enumerate(row))}</tr>" for row in table.rows)
    return (
        f'<section id="{_anchor(table.title)}"><h2>{html.escape(table.title)}</h2><p>{html.escape(table.sentence)}</p>'
        f'<div class="table"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div></section>'
    )


def _cell(table: Table, column: int, text: str) -> str:
    text = html.escape(text)
    return f"<td><code>{text}</code></td>" if column in table.codes and text else f"<td>{text}</td>"


def _anchor(title: str) -> str:
    return html.escape(title.lower().replace(" ", "-"))


STYLE = """
:root { color-scheme: light; font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; }
body { max-width: 1180px; margin: 0 auto; padding: 0 1rem 4rem; }
h1 { margin: 1.5rem 0 0; } h1 + p { font-size: 1.1rem; margin-top: .3rem; }
nav { font-size: .9rem; line-height: 1.9; } a { color: #0072B2; }
section { margin: 2.5rem 0; break-inside: avoid; } h2 { margin: 0 0 .2rem; font-size: 1.25rem; }
section > p { margin: .2rem 0 .6rem; max-width: 75ch; }
.table { overflow-x: auto; } table { border-collapse: collapse; font-size: .9rem; }
th, td { text-align: left; padding: .3rem .8rem .3rem 0; border-bottom: 1px solid #ddd; vertical-align: top; }
td { min-width: 5.5rem; } td:first-child { min-width: 9rem; } td { font-variant-numeric: tabular-nums; }
code { font-size: .85em; background: #f4f4f4; padding: .1em .3em; user-select: all; overflow-wrap: anywhere; }
td:first-child code { white-space: nowrap; }
.tools { display: flex; gap: 1rem; justify-content: space-between; font-size: .85rem; min-height: 1.5em; }
.tools { max-width: none; }
@page { size: A4 landscape; margin: 12mm; }
@media print {
  :root { font-size: 12px; } body { max-width: none; padding: 0; }
  nav, .tools { display: none; }
  section { margin: 1.2rem 0; break-inside: auto; } section:has(img) { break-inside: avoid; }
  section > p { max-width: none; } h2, h2 + p { break-after: avoid; }
  .table { overflow: visible; } table { width: 100%; } td, td:first-child { min-width: 0; }
  thead { display: table-header-group; } tr { break-inside: avoid; }
  img { max-width: 100%; min-width: 50%; max-height: 130mm; object-fit: contain; object-position: left; }
  a, code { color: inherit; background: none; text-decoration: none; }
}
"""

ONCE = """
@media screen { section > img { display: none; } }
@media print { .figure { display: none; } }
"""
"""Each figure once: interactive on a screen, drawn on paper."""

SCRIPT = """
for (const place of document.querySelectorAll('.figure')) {
  const spec = JSON.parse(place.nextElementSibling.textContent);
  const tools = place.parentElement.querySelector('.command');
  const narrow = () => place.clientWidth < 700;
  const draw = () => Plotly.react(place, spec.data, narrow() ? spec.narrow : spec.layout,
    {responsive: true, displaylogo: false, displayModeBar: false});
  draw().then(() => {
    let was = narrow();
    addEventListener('resize', () => { if (narrow() !== was) { was = narrow(); draw(); } });
    if (spec.commands) tools.textContent = 'click a point for the command that flies it';
    place.on('plotly_click', event => {
      const command = event.points.map(point => point.customdata).find(text => text);
      if (command) tools.textContent = command;
    });
  });
}
"""

TEMPLATE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>{title}</title>
<style>{style}</style>
<script>{plotly}</script>
</head>
<body>
<h1>{title}</h1>
<p>{question}</p>
<nav>{contents}</nav>
{body}
<script>{script}</script>
</body>
</html>
"""
