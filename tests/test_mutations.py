"""Tests that pass with the code broken prove nothing: random one-token mutations have to be noticed by the tests.

`MUTATIONS=60 MUTATED=controllers pytest -m long tests/test_mutations.py -s` mutates 60 places of one room and prints
what survived.
"""

import ast
import io
import os
import random
import shlex
import shutil
import subprocess
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = (
    "controllers",
    "heli_twin/lab",
    "heli_twin/metrics",
    "heli_twin/reporting/intervals.py",
    "heli_twin/identification",
)
SWAPS = {"+": "-", "-": "+", "*": "/", "/": "*", "**": "*", "<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!="} | {
    "!=": "==", "+=": "-=", "-=": "+=", "and": "or", "or": "and", "True": "False", "False": "True", "is": "is not",
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "cos": "sin", "sin": "cos",
}  # fmt: skip
CPU_LIMIT_S = 200
"""Of the tests of one mutation, in processor time, which a busy machine does not stretch; one that hangs is noticed."""
EQUIVALENT: dict[tuple[str, str], str] = {}
"""Mutations that change nothing a test could see: (module, mutated line without its indent) to the reason."""


class Mutation(NamedTuple):
    """One token of a module replaced."""

    file: str
    line: int
    """Counted from 1."""
    before: str
    after: str
    text: str
    """The whole mutated module."""

    def __str__(self) -> str:
        return f"{self.file}:{self.line}\n    - {self.before}\n    + {self.after}"


def replacement(token: tokenize.TokenInfo) -> str | None:
    if token.type == tokenize.NUMBER:
        value = ast.literal_eval(token.string)
        return repr(value + 1) if isinstance(value, int) else repr(1.5 * value or 1.0)
    return SWAPS.get(token.string) if token.type in (tokenize.OP, tokenize.NAME) else None


def unmutated_lines(tree: ast.AST) -> set[int]:
    """Of annotations and imports: bounds, units and names, which the tests of the experiment look at."""
    lines: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.AnnAssign):
            lines.update(range(node.annotation.lineno, (node.annotation.end_lineno or 0) + 1))
        elif isinstance(node, ast.Import | ast.ImportFrom):
            lines.update(range(node.lineno, (node.end_lineno or 0) + 1))
    return lines


def mutations(file: Path) -> Iterator[Mutation]:
    source = file.read_text(encoding="utf-8")
    lines, left_out = source.splitlines(keepends=True), unmutated_lines(ast.parse(source))
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        new, (row, column) = replacement(token), token.start
        if new is None or row in left_out:
            continue
        before = lines[row - 1]
        after = before[:column] + new + before[token.end[1] :]
        text = "".join([*lines[: row - 1], after, *lines[row:]])
        try:
            ast.parse(text)
        except SyntaxError:
            continue
        yield Mutation(file.relative_to(ROOT).as_posix(), row, before.strip(), after.strip(), text)


def mirrored_tests(file: str) -> list[str]:
    """The mirrored tests, from near to far: those of the module, if there are some, and those of its room."""
    path = Path(file)
    room = Path(*path.parts[int(path.parts[0] == "heli_twin") :]).parent
    name = path.parent.name if path.stem == "__init__" else path.stem
    folders = [Path("tests") / folder for folder in (room, *room.parents)]
    near = [f"{folder}/test_{stem}.py" for folder in folders for stem in (name, path.parent.name)]
    own = [test for test in near if (ROOT / test).exists()][:1]
    return [*own, *([f"tests/{room.parts[0]}"] if (ROOT / "tests" / room.parts[0]).is_dir() else [])]


def survives(mutation: Mutation, copy: Path) -> bool:
    mutated = copy / mutation.file
    original = mutated.read_text(encoding="utf-8")
    mutated.write_text(mutation.text, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    words = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *mirrored_tests(mutation.file)]
    limit = f"ulimit -t {CPU_LIMIT_S}; exec {shlex.join(words)}"
    try:
        done = subprocess.run(["bash", "-c", limit], cwd=copy, env=environment, capture_output=True, check=False)
    finally:
        mutated.write_text(original, encoding="utf-8")
    return done.returncode == 0


@pytest.mark.long
def test_the_tests_notice_nineteen_of_twenty_mutations(tmp_path):
    rooms = os.environ.get("MUTATED", " ".join(ROOMS)).split()
    files = [
        path for room in rooms for path in ([ROOT / room] if room.endswith(".py") else (ROOT / room).rglob("*.py"))
    ]
    every = [mutation for file in sorted(files) for mutation in mutations(file)]
    seed, count = int(os.environ.get("MUTATION_SEED", "0")), int(os.environ.get("MUTATIONS", "200"))
    sample = random.Random(seed).sample(every, min(count, len(every)))
    for folder in ("controllers", "heli_twin", "models", "tests"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    sample = [mutation for mutation in sample if (mutation.file, mutation.after) not in EQUIVALENT]
    survivors: list[Mutation] = []
    for mutation in sample:
        if survives(mutation, tmp_path):
            survivors.append(mutation)
            print(mutation, flush=True)
    print(f"{len(survivors)} of {len(sample)} mutations survived, {len(every)} are possible")
    assert len(survivors) <= 0.05 * len(sample), "\n".join(map(str, survivors))


def test_every_mutated_module_has_tests_and_every_equivalent_mutation_is_one():
    for room in ROOMS:
        for file in [ROOT / room] if room.endswith(".py") else (ROOT / room).rglob("*.py"):
            assert mirrored_tests(file.relative_to(ROOT).as_posix()), file
    for file, after in EQUIVALENT:
        assert after in {mutation.after for mutation in mutations(ROOT / file)}
