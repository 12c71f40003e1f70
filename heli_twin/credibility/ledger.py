"""The ledger: claims and factors, each with its evidence. A test of the project checks that the evidence exists."""

import ast
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from heli_twin.errors import HeliTwinError
from heli_twin.terminal_text import clean

LEDGER = Path(__file__).with_name("ledger.toml")

STATUSES: Mapping[str, str] = {
    "validated": "a witness outside this code agrees",
    "verified": "it agrees with mathematics or with itself, by tests; nobody outside has looked",
    "fitted": "a value was chosen so that it agrees: it shows that agreement is possible, no more",
    "not validated": "nothing shows it yet; what is missing is said",
}
"""What a claim may be, from the strongest on."""

FACTORS: Mapping[str, str] = {
    "data pedigree": "capability",
    "verification": "capability",
    "validation": "capability",
    "development technical review": "capability",
    "development process and product management": "capability",
    "use assessment": "results",
    "input pedigree": "results",
    "uncertainty characterization": "results",
    "results robustness": "results",
    "use technical review": "results",
    "use process and product management": "results",
}
"""The factors of NASA-STD-7009B, and whether they are of the simulation or of results with it."""

LEVELS = range(5)
"""0: insufficient evidence. 4: the best that the standard knows, which needs the real system over its whole range."""

KINDS = ("test", "proof", "study", "file", "log", "command")
"""What evidence may be: `test:tests/x.py::test_y`, `proof:` for one that takes long, `study:mass`, `file:PATH`,
`log:PATH`, `command:paper`."""


class Witness(NamedTuple):
    """Something outside this code that can agree or not."""

    name: str
    what: str
    mark: str
    """A word that evidence with this witness has in its file, so that it really asks it."""


class Claim(NamedTuple):
    """Something that is said of the twin."""

    text: str
    status: str
    evidence: tuple[str, ...]
    witness: str
    """The name of a witness; empty unless validated."""
    missing: str
    """What would show it, or more of it; empty if nothing is missing."""


class Factor(NamedTuple):
    """One factor of credibility."""

    name: str
    level: int
    why: str
    evidence: tuple[str, ...]
    missing: str
    """What the next level needs."""


class Ledger(NamedTuple):
    """All of it."""

    witnesses: tuple[Witness, ...]
    claims: tuple[Claim, ...]
    factors: tuple[Factor, ...]


def read_ledger(path: Path = LEDGER) -> Ledger:
    """Read a ledger.

    Raises:
        HeliTwinError: It cannot be read, or a row is not whole; names the row.
    """
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise HeliTwinError(f"cannot read the ledger {clean(path, 200)}: {clean(error, 200)}") from None
    witnesses = tuple(Witness(name, **_texts(f"witnesses.{name}", row, "what", "mark"))
                      for name, row in _tables(tree, "witnesses"))  # fmt: skip
    claims = tuple(_claim(row) for row in _rows(tree, "claims"))
    factors = tuple(_factor(name, row) for name, row in _tables(tree, "factors"))
    if troubles := [*_troubles(witnesses, claims, factors)]:
        raise HeliTwinError(f"{clean(path.name, 60)}: {troubles[0]}")
    return Ledger(witnesses, claims, factors)


def _tables(tree: Mapping[str, Any], name: str) -> Iterator[tuple[str, Mapping[str, Any]]]:
    for key, row in tree.get(name, {}).items():
        if not isinstance(row, dict):
            raise HeliTwinError(f"{name}.{clean(key, 60)} = {clean(row, 60)}: it has to be a table")
        yield key, row


def _rows(tree: Mapping[str, Any], name: str) -> list[Mapping[str, Any]]:
    rows = tree.get(name, [])
    if not isinstance(rows, list):
        raise HeliTwinError(f"{name} has to be a list of tables, [[{name}]]")
    return rows


def _texts(row_name: str, row: Mapping[str, Any], *names: str) -> dict[str, str]:
    texts = {name: row.get(name) for name in names}
    for name, text in texts.items():
        if not isinstance(text, str) or not text:
            raise HeliTwinError(f"{clean(row_name, 80)} has no {name}: write a text")
    return {name: str(text) for name, text in texts.items()}


def _evidence(row: Mapping[str, Any]) -> tuple[str, ...]:
    evidence = row.get("evidence", [])
    return tuple(map(str, evidence)) if isinstance(evidence, list) else (str(evidence),)


def _claim(row: Mapping[str, Any]) -> Claim:
    texts = _texts(f"claim '{row.get('claim', '')}'", row, "claim", "status")
    return Claim(
        texts["claim"], texts["status"], _evidence(row), str(row.get("witness", "")), str(row.get("missing", ""))
    )


def _factor(name: str, row: Mapping[str, Any]) -> Factor:
    level = row.get("level")
    if not isinstance(level, int) or isinstance(level, bool) or level not in LEVELS:
        raise HeliTwinError(f"factors.{clean(name, 60)}.level = {clean(level, 20)}: write 0, 1, 2, 3 or 4")
    return Factor(
        name.replace("_", " "), level, _texts(name, row, "why")["why"], _evidence(row), str(row.get("missing", ""))
    )


def _troubles(witnesses: tuple[Witness, ...], claims: tuple[Claim, ...], factors: tuple[Factor, ...]) -> Iterator[str]:
    """Each rule that a row breaks, one sentence each."""
    names = [witness.name for witness in witnesses]
    for claim in claims:
        row = f"claim '{clean(claim.text, 80)}'"
        if claim.status not in STATUSES:
            yield f"{row} has status '{clean(claim.status, 30)}': write one of {', '.join(STATUSES)}"
        if not claim.evidence:
            yield f"{row} has no evidence: name what shows it, or how far it is shown"
        if claim.status == "validated" and claim.witness not in names:
            yield f"{row} is called validated without a witness outside this code: name one of {', '.join(names)}"
        if claim.status != "validated" and claim.witness:
            yield f"{row} has a witness and is not called validated"
        if claim.status in ("fitted", "not validated") and not claim.missing:
            yield f"{row} is {claim.status}: say in `missing` what would show it"
    for name in FACTORS:
        if name not in [factor.name for factor in factors]:
            yield f"the factor '{name}' of the standard has no row"
    for factor in factors:
        row = f"factor '{clean(factor.name, 60)}'"
        if factor.name not in FACTORS:
            yield f"{row} is none of the standard's"
        if not factor.evidence:
            yield f"{row} has no evidence: name what shows its level"
        if factor.level < max(LEVELS) and not factor.missing:
            yield f"{row} is at level {factor.level}: say in `missing` what the next one needs"


def not_found(ledger: Ledger, root: Path) -> list[str]:
    """Return what is wrong with the evidence of a ledger: what does not exist, or does not ask its witness.

    Args:
        ledger: To check.
        root: Of the project's source, with its tests.
    """
    marks = {witness.name: witness.mark for witness in ledger.witnesses}
    troubles: list[str] = []
    for row in (*ledger.claims, *ledger.factors):
        name = row.text if isinstance(row, Claim) else row.name
        troubles += [f"'{name}': {trouble}" for each in row.evidence if (trouble := _trouble(each, root))]
        if (
            isinstance(row, Claim)
            and row.witness
            and not any(_mentions(e, marks[row.witness], root) for e in row.evidence)
        ):
            troubles.append(f"'{name}': no evidence mentions {marks[row.witness]}, the mark of its witness")
    return troubles


def _trouble(evidence: str, root: Path) -> str:
    """Return why a piece of evidence does not exist; empty if it does."""
    kind, _, where = evidence.partition(":")
    if kind not in KINDS or not where:
        return f"'{clean(evidence, 80)}' is no evidence: begin it with one of {', '.join(f'{k}:' for k in KINDS)}"
    if kind == "study":
        found = (root / "heli_twin" / "studies" / "library" / f"{where}.toml").is_file()
        return "" if found else f"no study '{clean(where, 60)}' is shipped"
    if kind == "command":
        found = any((root / "heli_twin" / "commands" / f"{where}{tail}.py").is_file() for tail in ("", "_"))
        return "" if found else f"there is no command '{clean(where, 60)}'"
    path, _, test = where.partition("::")
    if not (root / path).is_file():
        return f"there is no file {clean(path, 120)}"
    if kind in ("test", "proof"):
        found = test_in(root / path, test)
        if found is None:
            return f"{clean(path, 120)} has no test '{clean(test, 80)}'"
        is_long = any("mark.long" in ast.unparse(decorator) for decorator in found.decorator_list)
        if is_long != (kind == "proof"):
            return (
                f"{clean(test, 80)} is {'a proof' if is_long else 'no proof'}: write {'proof' if is_long else 'test'}:"
            )
    return ""


def test_in(path: Path, name: str) -> ast.FunctionDef | None:
    """Return a test of a file, parsed; None if it has none of this name."""
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    tests = (n for n in nodes if isinstance(n, ast.FunctionDef) and n.name.startswith("test_"))
    return next((test for test in tests if test.name == name), None)


def _mentions(evidence: str, mark: str, root: Path) -> bool:
    kind, _, where = evidence.partition(":")
    path = root / where.partition("::")[0]
    return kind in ("test", "proof", "file") and path.is_file() and mark in path.read_text(encoding="utf-8")
