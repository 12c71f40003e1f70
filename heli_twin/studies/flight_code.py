"""A hash of the code that decides a flight's row, so that rows of different code are not mixed without a word.

It covers the modules of a flight, the helicopter's MJCF and the versions of three packages. Comments, docstrings, line
breaks, paths and compiled files do not change it.
"""

import ast
import hashlib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path

import controllers
import heli_twin
from heli_twin.lab.plant.mujoco import model_file

ROOMS = (
    *("controllers", "heli_twin/experiment", "heli_twin/lab", "heli_twin/metrics", "heli_twin/recording"),
    "heli_twin/several",
)
MODULES = (
    *("flight.py", "logbook.py", "mission.py", "studies/columns.py", "studies/work.py"),
    *(f"requirements/{name}.py" for name in ("file", "formula", "judge", "parser", "signals", "units")),
)
PACKAGES = ("mujoco", "numpy", "proxsuite")
HASH_DIGITS = 16
NAMED_CHANGES = 3
"""Changed parts that a message names at most."""


@cache
def file_hash() -> str:
    """Hash of the files as they were at the first call of this process. Equal files have equal code."""
    whole = hashlib.sha256()
    for name, data in (*_files(), *_versions()):
        whole.update(f"{name}\n{len(data)}\n".encode() + data)
    return whole.hexdigest()[:HASH_DIGITS]


@cache
def code_parts() -> dict[str, str]:
    """The hash of each module's syntax tree and of the MJCF, and each package's version, by name."""
    hashes = {name: _hash(_meaning(name, data)) for name, data in _files()}
    return hashes | {name: data.decode() for name, data in _versions()}


def code_hash() -> str:
    """One hash of all parts."""
    return _hash("\n".join(f"{name} {value}" for name, value in sorted(code_parts().items())))


def changes_of(before: Mapping[str, str], after: Mapping[str, str]) -> str:
    """Name the parts that differ, such as `controllers/laws/pid.py, numpy 2.1.0 became 2.2.0 and 4 more`."""
    names = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    told = [
        f"{name} {before.get(name)} became {after.get(name)}" if name in PACKAGES else name
        for name in names[:NAMED_CHANGES]
    ]
    more = len(names) - len(told)
    return ", ".join(told) + (f" and {more} more" if more else "")


def mixed_codes(codes: Mapping[str, int]) -> str:
    """Say how many flights each code flew, the most first."""
    by_number = sorted(codes.items(), key=lambda item: -item[1])
    return ", ".join(f"{number} by {code or 'code without a hash'}" for code, number in by_number)


def _files() -> Iterator[tuple[str, bytes]]:
    """The files of a flight, by names that do not depend on where they are installed."""
    homes = {package.__name__: Path(str(package.__file__)).parent for package in (controllers, heli_twin)}
    for room in ROOMS:
        package, _, folder = room.partition("/")
        for path in sorted((homes[package] / folder).rglob("*.py")):
            yield f"{package}/{path.relative_to(homes[package]).as_posix()}", path.read_bytes()
    for name in MODULES:
        yield f"heli_twin/{name}", (homes["heli_twin"] / name).read_bytes()
    yield "models/mcx2.xml", model_file().read_bytes()


def _versions() -> Iterator[tuple[str, bytes]]:
    for package in PACKAGES:
        yield package, version(package).encode()


def _meaning(name: str, data: bytes) -> str:
    """The text of a file without what has no effect."""
    if not name.endswith(".py"):
        return "\n".join(data.decode().splitlines())
    tree = ast.parse(data)
    blocks: list[ast.AST] = [tree]
    while blocks:
        node = blocks.pop()
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [line for line in body if not _is_docstring(line)]  # pyright: ignore[reportAttributeAccessIssue]
        # Statements alone have blocks, not the many expressions in them.
        blocks += [child for child in ast.iter_child_nodes(node) if isinstance(child, _WITH_BLOCKS)]
    return ast.dump(tree)


_WITH_BLOCKS = ast.stmt, ast.excepthandler, ast.match_case


def _is_docstring(line: ast.stmt) -> bool:
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) and isinstance(line.value.value, str)


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:HASH_DIGITS]
