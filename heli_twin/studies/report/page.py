"""One page that needs no network: tables, interactive figures, and a command behind every point."""

import html
from base64 import b64encode
from collections.abc import Callable, Iterator
from pathlib import Path

from heli_twin.reporting import plotly_json
from heli_twin.reporting.figure import Figure, Table
from heli_twin.reporting.html_page import Section, html_page, json_block, table_section
from heli_twin.reporting.svg import write_svg
from heli_twin.studies import PAGE
from heli_twin.studies.errors import StudyError
from heli_twin.studies.report.boundary import boundary
from heli_twin.studies.report.bounds import bounds
from heli_twin.studies.report.effort import effort, timing
from heli_twin.studies.report.fairness import fairness, stability
from heli_twin.studies.report.ladder import ladder
from heli_twin.studies.report.maps import maps
from heli_twin.studies.report.margins import margins
from heli_twin.studies.report.morris import morris
from heli_twin.studies.report.rare_event import rare_event
from heli_twin.studies.report.results import Results, results_of
from heli_twin.studies.report.search import search
from heli_twin.studies.report.sensitivity import sensitivity
from heli_twin.studies.report.tables import provenance, worst
from heli_twin.studies.report.tornado import tornado
from heli_twin.studies.report.verdict import verdict
from heli_twin.whole_file import whole_file, write_whole

SECTIONS = (
    verdict,
    bounds,
    stability,
    ladder,
    tornado,
    maps,
    boundary,
    margins,
    morris,
    sensitivity,
    search,
    rare_event,
    effort,
    timing,
    worst,
    fairness,
    provenance,
)
"""The sections of a report in their order; one that does not fit the study yields nothing."""

OF_WHOLE_DESIGNS = (ladder, tornado, maps, boundary, margins, morris, sensitivity, search, rare_event)
"""Sections that compare the points of a design: they are left out while some of its runs are invalid."""


def write_report(folder: Path, out: Path | None = None) -> Path:
    """Write `report.html` and an SVG for each figure.

    Args:
        folder: Of the study.
        out: Folder for the report; None for the study's.

    Returns:
        The path of the page.

    Raises:
        StudyError: There are no results, or the report cannot be written.
    """
    results = results_of(folder)
    parts = [part for section in SECTIONS for part in _parts(section, results)]
    page = (out or folder) / PAGE
    try:
        _write(page, results, parts)
    except OSError as error:
        raise StudyError(
            f"cannot write {error.filename2 or error.filename or page} ({error.strerror or error}): give a folder for"
            " the report with `heli-twin study report STUDY --out DIR`"
        ) from None
    return page


def _parts(section: Callable[[Results], Iterator[Figure | Table]], results: Results) -> Iterator[Figure | Table]:
    """The parts of a section; of a design, only when none of its runs is missing."""
    if not (results.invalid and section in OF_WHOLE_DESIGNS):
        yield from section(results)


def _write(page: Path, results: Results, parts: list[Figure | Table]) -> None:
    figures = page.parent / "figures"
    figures.mkdir(parents=True, exist_ok=True)
    for part in parts:
        if isinstance(part, Figure):
            with whole_file(figures / f"{part.name}.svg") as drawn:
                write_svg(part, drawn)
    sections = [_section(part, figures) if isinstance(part, Figure) else table_section(part) for part in parts]
    title = results.study.name.replace("_", " ")
    scripts = f"<script>{plotly_json.library()}</script><script>{SCRIPT}</script>"
    text = html_page(title, results.study.question, sections, style=SCREEN_OR_PRINT_STYLE, scripts=scripts)
    write_whole(page, text.encode())


def _section(figure: Figure, folder: Path) -> Section:
    """A figure twice: the interactive one for the screen, the drawn one for paper, where nothing can be clicked."""
    drawn = b64encode((folder / f"{figure.name}.svg").read_bytes()).decode()
    return Section(
        figure.title,
        f"<p>{html.escape(figure.sentence)}</p>"
        f'<img alt="{html.escape(figure.title)}" src="data:image/svg+xml;base64,{drawn}">'
        f'<div class="figure"></div>{json_block(plotly_json.spec(figure))}'
        f'<p class="tools"><code class="command"></code><a href="figures/{figure.name}.svg">SVG</a></p>',
    )


SCREEN_OR_PRINT_STYLE = """
@media screen { section > img { display: none; } .command:empty { display: none; } }
.tools a { margin-left: auto; }
@media print { .figure { display: none; } }
"""
"""Shows each figure once: the interactive one on a screen, the drawn one on paper."""

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
