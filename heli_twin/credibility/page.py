"""The ledger as one HTML page: what is shown first by whom, then what is not."""

import ast
import html
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from heli_twin.credibility.ledger import FACTORS, LEVELS, STATUSES, Claim, Factor, Ledger, test_in
from heli_twin.reporting.html_page import Section, html_page, html_table
from heli_twin.reporting.words import listed

SOURCE = Path(__file__).parents[2]
"""Of the project, with its tests; an installed package is without them, and then the page shows names alone."""
COMMANDS = {
    "test": "pytest",
    "proof": "pytest -m long",
    "study": "heli-twin study run",
    "log": "heli-twin replay",
    "command": "heli-twin",
}


def told(evidence: str) -> str:
    """Return evidence as the command that shows it, or as the name of a file."""
    kind, _, where = evidence.partition(":")
    return f"{COMMANDS[kind]} {where}" if kind in COMMANDS else where


def short(evidence: str) -> str:
    """Return evidence by its last name, for a narrow table."""
    kind, _, where = evidence.partition(":")
    name = where.partition("::")[2] or where
    return name if kind in ("test", "proof", "file", "log") else told(evidence)


def summary(ledger: Ledger) -> str:
    """Return in one sentence how many claims have which status."""
    counts = Counter(claim.status for claim in ledger.claims)
    parts = [f"{counts[status]} {status}" for status in STATUSES if counts[status]]
    levels = [factor.level for factor in ledger.factors]
    return (
        f"Of {len(ledger.claims)} claims {listed(parts)}; the factors of NASA-STD-7009B are at levels {min(levels)} to"
        f" {max(levels)} of {max(LEVELS)}, by our own assessment."
    )


def credibility_page(ledger: Ledger, source: Path = SOURCE) -> str:
    """Return the whole page.

    Args:
        ledger: What it says.
        source: Root of the project's source, for the text of tests and studies; what is not there is named only.
    """
    sections = [_claims(status, ledger.claims, source) for status in STATUSES]
    sections += [_factors(group, ledger.factors, source) for group in ("capability", "results")]
    sections.append(_witnesses(ledger))
    return html_page("Credibility", summary(ledger), [s for s in sections if s], style=STYLE)


def _claims(status: str, claims: Iterable[Claim], source: Path) -> Section:
    mine = [claim for claim in claims if claim.status == status]
    has_witness = status == "validated"
    rows = [
        [
            _cell(claim.text),
            *([_cell(claim.witness.replace("_", " "))] if has_witness else []),
            _evidence(claim.evidence, source),
            *([] if has_witness else [_cell(claim.missing)]),
        ]
        for claim in mine
    ]
    header = ["claim", "witness", "evidence"] if has_witness else ["claim", "evidence", "what would show it, or more"]
    title = status[0].upper() + status[1:]
    return Section(title, f"<p>{html.escape(_sentence(STATUSES[status]))}</p>{_table(header, rows)}")


def _factors(group: str, factors: Iterable[Factor], source: Path) -> Section:
    mine = [factor for factor in factors if FACTORS[factor.name] == group]
    rows = [
        [_cell(f.name), _level(f.level), _cell(f.why), _evidence(f.evidence, source), _cell(f.missing)] for f in mine
    ]
    title = f"Factors of the {'simulation' if group == 'capability' else 'results with it'}"
    text = (
        "Levels of NASA-STD-7009B, 0 (insufficient evidence) to 4 (the best that it knows); nobody outside has assessed"
        " them."
    )
    header = ["factor", "level", "why", "evidence", "what the next level needs"]
    return Section(title, f"<p>{text}</p>{_table(header, rows)}")


def _witnesses(ledger: Ledger) -> Section:
    used = Counter(claim.witness for claim in ledger.claims)
    rows = [[_cell(w.name.replace("_", " ")), _cell(w.what), _cell(str(used[w.name]))] for w in ledger.witnesses]
    text = "Outside of this code, so that they can disagree. Those of 0 claims have not been heard yet."
    return Section("Witnesses", f"<p>{text}</p>{_table(['witness', 'what it is', 'claims'], rows)}")


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table whose cells know their column, for windows too narrow to show columns."""
    named = [
        [
            f'<td data-column="{html.escape(column)}"{cell.removeprefix("<td")}'
            for column, cell in zip(header, row, strict=True)
        ]
        for row in rows
    ]
    return html_table(header, named)


def _cell(text: str) -> str:
    return f"<td>{html.escape(text)}</td>"


def _level(level: int) -> str:
    marks = "".join("\u25a0" if i < level else "\u25a1" for i in range(max(LEVELS)))
    return f'<td class="level">{level} <span aria-hidden="true">{marks}</span></td>'


def _evidence(evidence: Sequence[str], source: Path) -> str:
    return f"<td>{''.join(_shown(each, source) for each in evidence)}</td>"


def _shown(evidence: str, source: Path) -> str:
    """A piece of evidence by its command, over its text if there is one."""
    name, text = html.escape(told(evidence)), _text(evidence, source)
    if not text:
        return f"<div><code>{name}</code></div>"
    return f"<details><summary><code>{name}</code></summary><pre>{html.escape(text)}</pre></details>"


def _text(evidence: str, source: Path) -> str:
    """The source of a test or the text of a study; empty if it is not here."""
    kind, _, where = evidence.partition(":")
    path, _, test = where.partition("::")
    file = source / (f"heli_twin/studies/library/{where}.toml" if kind == "study" else path)
    if kind not in ("test", "proof", "study") or not file.is_file():
        return ""
    text = file.read_text(encoding="utf-8")
    if kind == "study":
        return text
    found = test_in(file, test)
    return (ast.get_source_segment(text, found) or "") if found else ""


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


STYLE = """
td { min-width: 10rem; } td.level { min-width: 5rem; white-space: nowrap; }
details, td div { margin: 0 0 .3rem; } summary { cursor: pointer; }
pre { font-size: .75rem; max-width: 36rem; overflow-x: auto; background: #f4f4f4; padding: .5rem; }
@media (max-width: 700px) {
  table, tbody, tr, td { display: block; } thead, td:empty { display: none; }
  tr { border-bottom: 1px solid #ddd; padding: .6rem 0; } td { border: 0; padding: .1rem 0; }
  td:first-child { font-weight: bold; }
  td:not(:first-child)::before { content: attr(data-column) ": "; color: #666; }
}
@media print { details > pre { display: none; } td.level { min-width: 0; } }
"""
