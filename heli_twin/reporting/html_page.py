"""One HTML page that needs no network: sections under a table of contents, styled for screen and paper."""

import html
import json
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from heli_twin.reporting.figure import Table


class Section(NamedTuple):
    """A part of a page."""

    title: str
    """Plain text."""
    body: str
    """HTML."""


def table_section(table: Table) -> Section:
    """A table under its title and sentence."""
    rows = [[_cell(cell, i in table.codes) for i, cell in enumerate(row)] for row in table.rows]
    return Section(table.title, f"<p>{html.escape(table.sentence)}</p>{html_table(table.header, rows)}")


def html_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of cells that are HTML already, `<td>` included, under a header of plain text."""
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in header)
    body = "".join(f"<tr>{''.join(row)}</tr>" for row in rows)
    return f'<div class="table"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def json_block(data: Any) -> str:
    """Data for a script of the page; no text in it can end the block or begin another one."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return f'<script type="application/json">{text}</script>'


def _cell(text: str, is_code: bool) -> str:
    if is_code and text:
        return f"<td><code>{html.escape(text)}</code></td>"
    return f"<td>{_PATH.sub(BREAK_HERE, html.escape(text))}</td>"


_PATH = re.compile(r"(?<=[a-z_][./_])(?=[a-z])")
BREAK_HERE = "<wbr>"
"""Lets a long path of a field or a file go on in the next line."""


def html_page(title: str, question: str, sections: Sequence[Section], *, style: str = "", scripts: str = "") -> str:
    """The whole page.

    Args:
        title: Plain text.
        question: What the page answers, plain text.
        sections: In their order on the page.
        style: CSS beside the common one.
        scripts: HTML at the end of the body.
    """
    return TEMPLATE.format(
        title=html.escape(title),
        question=html.escape(question),
        style=STYLE + style,
        contents=" \u00b7 ".join(f'<a href="#{_anchor(s.title)}">{html.escape(s.title)}</a>' for s in sections),
        body="\n".join(
            f'<section id="{_anchor(s.title)}"><h2>{html.escape(s.title)}</h2>{s.body}</section>' for s in sections
        ),
        scripts=scripts,
    )


def _anchor(title: str) -> str:
    return "-".join("".join(c if c.isalnum() else " " for c in title.lower()).split())


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
h1, h2, td, th { overflow-wrap: break-word; }
code { font-size: .85em; background: #f4f4f4; padding: .1em .3em; user-select: all; overflow-wrap: anywhere; }
.tools { display: flex; gap: 1rem; justify-content: space-between; font-size: .85rem; min-height: 1.5em; }
.tools { max-width: none; }
@page { size: A4; margin: 12mm; }
@media print {
  :root { font-size: 11px; } body { max-width: none; padding: 0; }
  nav, .tools { display: none; }
  section { margin: 1rem 0; break-inside: auto; } section:has(img) { break-inside: avoid; }
  section > p { max-width: none; } h2, h2 + p { break-after: avoid; }
  .table { overflow: visible; } table { width: 100%; } td, td:first-child { min-width: 0; }
  thead { display: table-header-group; } tr { break-inside: avoid; }
  img { max-width: 100%; max-height: 200mm; object-fit: contain; object-position: left; }
  a, code { color: inherit; background: none; text-decoration: none; }
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
</head>
<body>
<h1>{title}</h1>
<p>{question}</p>
<nav>{contents}</nav>
{body}
{scripts}
</body>
</html>
"""
