import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("controllers", "heli_twin")


def run(*command: str, code: str = "") -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT), "NO_COLOR": "1"}
    words = [sys.executable, "-c", code] if code else [str(Path(sys.executable).parent / command[0]), *command[1:]]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, env=environment, check=False)


@pytest.mark.parametrize(
    "command",
    [
        ("ruff", "check", "."),
        ("ruff", "format", "--check", "."),
        ("basedpyright", "--pythonpath", sys.executable),
        ("lint-imports",),
    ],
    ids=lambda command: " ".join(command[:2]),
)
def test_the_tools_of_ci_have_nothing_to_say(command):
    done = run(*command)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout[-4000:]}{done.stderr[-2000:]}"


def modules() -> list[str]:
    return sorted(str(path.relative_to(ROOT)) for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def imported(file: str) -> Iterator[str]:
    """Top-level names of what a file imports, anywhere in it."""
    for node in ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield (node.module or "").partition(".")[0]


def test_the_ground_station_imports_numpy_proxsuite_and_itself():
    allowed = {"numpy", "proxsuite", "annotated_types", "controllers", *sys.stdlib_module_names}
    for file in modules():
        if file.startswith("controllers/"):
            assert set(imported(file)) <= allowed, file


LOADED = "import sys\n{}\nprint([m for m in {!r} if m in sys.modules])"


def test_a_flight_does_not_load_what_it_does_not_need():
    flight = "import heli_twin\nheli_twin.fly(heli_twin.load('lab', ['duration=0.1']), log_dir=None)"
    done = run(code=LOADED.format(flight, ["rerun", "scipy", "distributed", "pebble", "pyarrow", "rich"]))
    assert (done.stdout, done.stderr) == ("[]\n", "")


def test_help_comes_at_once():
    """Heavy imports belong inside what a command runs."""
    say = "from heli_twin.cli import main\ntry:\n    main(['--help'])\nexcept SystemExit:\n    pass"
    done = run(
        code=LOADED.format(
            say, ["mujoco", "proxsuite", "pydantic", "rerun", "scipy", "pyarrow", "distributed", "pebble", "matplotlib"]
        )
    )
    assert done.stdout.startswith("usage: heli-twin")
    assert done.stdout.endswith("\n[]\n")


@pytest.mark.parametrize("file", modules())
def test_every_module_begins_by_saying_what_it_is_for(file):
    if not file.endswith("_pb2.py"):
        assert ast.get_docstring(ast.parse((ROOT / file).read_text(encoding="utf-8"))), file


def test_blocks_are_frozen_and_have_slots():
    """A misspelt field is an error at once, and a block that is shared cannot be changed."""
    for file in modules():
        if file.startswith(("controllers/", "heli_twin/lab/")):
            for node in ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8"))):
                for decorator in node.decorator_list if isinstance(node, ast.ClassDef) else []:
                    if (text := ast.unparse(decorator)).startswith("dataclass"):
                        assert text == "dataclass(frozen=True, slots=True)", file


def test_tests_are_files_and_no_package():
    """With `__init__.py` they would be imported from the checkout instead of from where the tests are."""
    assert not list((ROOT / "tests").rglob("__init__.py"))
