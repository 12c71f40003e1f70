"""A mutation run: one token of a module is replaced, and the nearest tests have to notice it.

`python tests/mutants.py controllers 60` mutates 60 places of one room (a third word is the seed) and prints a table.
Each mutant is tested in a fork of a process that has already imported the libraries, in a copy of the repository.
What the nearest tests let pass meets all tests of its part.
"""

import ast
import io
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tokenize
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

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
TEST_FILES = 3
"""The nearest test files of a module, which meet its mutants first."""
OTHER_NAMES = {
    "heli_twin/experiment/families.py": ["own/test_own_members.py", "experiment/test_families.py"],
    "heli_twin/experiment/named_classes.py": ["own/test_own_members.py"],
    "heli_twin/experiment/family_needs.py": ["own/test_own_members.py", "test_conformance.py"],
    "heli_twin/experiment/own.py": ["own/test_own_members.py"],
    "controllers/linear_equation.py": ["controllers/test_linear_equation.py"],
    "controllers/laws/external.py": ["own/test_external_laws.py"],
    "controllers/line_process.py": ["own/test_external_laws.py"],
    "controllers/programs.py": ["own/test_external_laws.py"],
    "controllers/receding.py": ["controllers/test_ltv_mpc.py", "controllers/test_detailed_flight.py"],
    "controllers/planar.py": ["controllers/test_condensed_qp.py"],
    "controllers/detailed_ltv.py": ["controllers/test_detailed_model.py", "controllers/test_detailed_flight.py"],
    "controllers/detailed_flatness.py": ["controllers/test_detailed_model.py", "controllers/test_detailed_flight.py"],
    "controllers/laws/detailed_mpc.py": ["controllers/test_detailed_flight.py", "controllers/test_detailed_model.py"],
    "controllers/detailed_motion.py": ["controllers/test_detailed_kalman.py", "controllers/test_detailed_flight.py"],
    "controllers/estimators/detailed_kalman.py": [
        "controllers/test_detailed_kalman.py",
        "controllers/test_detailed_flight.py",
    ],
    "controllers/pace.py": ["controllers/test_derivatives.py", "controllers/test_trajectories.py"],
    "controllers/descent.py": ["controllers/test_supervisor.py"],
    "controllers/markers.py": ["controllers/test_pid.py", "lab/test_mocap.py"],
    "controllers/pose_screen.py": ["controllers/test_pose_screen.py", "controllers/test_kalman.py"],
    "controllers/rotations.py": [
        "controllers/test_rotations.py",
        "controllers/test_flatness.py",
        "controllers/test_pid.py",
        "controllers/test_offset_free.py",
    ],
    "controllers/splines.py": [
        "controllers/test_splines.py",
        "controllers/test_derivatives.py",
        "controllers/test_trajectories.py",
    ],
    **{
        f"controllers/{name}.py": [f"controllers/{near}.py", "controllers/coordinations/test_sequential.py"]
        for name, near in {
            "right_of_way": "test_right_of_way",
            "scene": "test_scene",
            "separation": "coordinations/test_separation",
            "turns": "test_take_off",
            "take_off": "test_take_off",
            "emergency": "test_emergency",
            "wish_plan": "test_wish_plan",
            "plan_qp": "coordinations/test_plan_qp",
            "committed_plan": "coordinations/test_committed_plan",
            "escape": "test_escape",
        }.items()
    },
    "heli_twin/several/room.py": ["several/test_room.py", "lab/test_downwash.py"],
    "controllers/coordinations/sequential.py": [
        "controllers/coordinations/test_sequential.py",
        "controllers/test_escape.py",
    ],
    "heli_twin/metrics/several.py": ["metrics/test_several.py", "several/test_room.py"],
    "heli_twin/lab/compute.py": ["lab/test_faults.py", "lab/test_chance.py", "flights/test_flights.py"],
    "heli_twin/lab/plant/contract.py": ["lab/plant/test_refused_airframes.py", "lab/plant/test_airframe.py"],
    "heli_twin/lab/plant/airframe.py": ["lab/plant/test_airframe.py", "lab/plant/test_refused_airframes.py"],
    "heli_twin/lab/plant/mjcf_text.py": ["lab/plant/test_refused_airframes.py"],
    "heli_twin/lab/plant/motion.py": ["lab/plant/test_mujoco.py", "lab/plant/test_airframe.py"],
    "heli_twin/lab/plant/twin.py": [
        "lab/plant/test_mujoco.py",
        "lab/plant/test_world.py",
        "lab/plant/effects/test_effects.py",
        "lab/plant/test_airframe.py",
    ],
    "heli_twin/lab/plant/__init__.py": ["lab/plant/test_ideal.py", "lab/plant/effects/test_effects.py"],
}
"""The tests of modules whose name no test file has, in `tests/`, nearest first."""
PICTURES = {"heli_twin/lab/plant/renderer.py"}
"""Modules that draw: their lights and colours are looked at, and decide no flight and no figure."""
FOLDER_TESTS = {
    "controllers/trajectories": ["tests/controllers/test_derivatives.py"],
    "controllers": ["tests/flights/test_pinned.py"],
    "heli_twin/lab": ["tests/flights/test_pinned.py"],
}
"""Further tests of every module below a folder."""
TEST_CPU_LIMIT_S = 60
"""Of one test, in processor time, which a busy machine does not stretch; a mutant that hangs is noticed by it."""
LIBRARIES = """numpy scipy.optimize scipy.linalg scipy.stats scipy.integrate scipy.signal pydantic daqp threadpoolctl
hypothesis.strategies annotated_types mujoco google.protobuf mcap.reader zstandard foxglove_schemas_protobuf"""


EQUIVALENT = {
    (module, line): reason
    for module, lines in tomllib.loads((ROOT / "tests/equivalent_mutations.toml").read_text("utf-8")).items()
    for line, reason in lines.items()
}
"""Mutations that change nothing a test could see: (module, mutated line without its indent) to the reason."""
EQUIVALENT_KINDS = {
    r"\bclean\(.*, \d*1\)": "a message shows one more character of it",
    r"^NEVER_NS = ": "later than every flight",
    r"\bPARKED_M\b": "what is parked out of the way meets nobody there, nor beside it",
    r"^BLOCK(_SAMPLES)? = ": "drawn or computed one more at a time, the numbers are the same",
    r"mjGEOM_PLANE, size=\((?!5\.0, 5\.0, 0\.1\))": "a floor is infinite: its size is drawn",
    r"^def .*, /, ": "what is given by name is given by name with `/` before it too",
    r"\breshape\(-2\b": "NumPy takes any negative length for the one that is left",
    r"\bstrict=False\b": "`strict` of `zip` guards against lengths that no caller gives",
    r"\blru_cache\((maxsize=)?\d+\)": "one more answer is kept",
    r"\bcolor=\d+\b": "another colour of a curve",
    r"\bfor _ in range\(\d+\)": "one more iteration of a search that has ended",
    r"(?:[-+<>]=? |, )1\.5\d*e-(?:0[6-9]|1\d)(?! \*)": "a millionth, or a guard against 0, half as large again",
    r"\brng=1\b": "another draw of the same bootstrap",
    r"\bn_resamples=1000\b": "one more resample of a bootstrap moves an interval by less than its own error",
}
"""Mutated lines of any module that change nothing a test could see, to the reason."""


class Mutation(NamedTuple):
    """One token of a module replaced."""

    file: str
    line: int
    """Counted from 1."""
    before: str
    after: str
    text: str
    """The whole mutated module."""


def replacement(token: tokenize.TokenInfo) -> str | None:
    if token.type == tokenize.NUMBER:
        value = ast.literal_eval(token.string)
        return repr(value + 1) if isinstance(value, int) else repr(1.5 * value or 1.0)
    return SWAPS.get(token.string) if token.type in (tokenize.OP, tokenize.NAME) else None


def unmutated_lines(tree: ast.AST) -> set[int]:
    """Of annotations, imports, decorators and defaults of fields: bounds, units, names, which other tests look at."""
    nodes: list[ast.AST] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.AnnAssign):
            nodes.append(node.annotation)
            if isinstance(node.value, ast.Constant):
                nodes.append(node.value)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            nodes.append(node)
        elif isinstance(node, ast.ClassDef):
            nodes.extend(node.decorator_list)
    return {line for node in nodes for line in range(node.lineno, (node.end_lineno or 0) + 1)}


def mutations(file: Path) -> Iterator[Mutation]:
    """Yield every mutation of a module that is valid Python."""
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


def modules(room: str) -> list[Path]:
    paths = [ROOT / room] if room.endswith(".py") else sorted((ROOT / room).rglob("*.py"))
    return [path for path in paths if path.relative_to(ROOT).as_posix() not in PICTURES]


def nearest_tests(file: str) -> list[str]:
    """Return the test files of a module, nearest first.

    They have its name or its folder's, or import it; where none does, others import its package.
    """
    path = Path(file)
    further = [test for folder, tests in FOLDER_TESTS.items() if path.is_relative_to(folder) for test in tests]
    if file in OTHER_NAMES:
        return [f"tests/{name}" for name in OTHER_NAMES[file]] + further
    folder = ROOT / "tests" / path.parts[int(path.parts[0] == "heli_twin")]
    dotted = ".".join(path.with_suffix("").parts).removesuffix(".__init__")
    package, _, name = dotted.rpartition(".")
    names = [f"test_{name}.py", f"test_{path.parent.name}.py"]
    tests = _tests_of(folder, names, dotted) if folder.is_dir() else []
    tests = tests or _tests_of(ROOT / "tests", names[:1], dotted) or _tests_of(ROOT / "tests", [], package)
    return tests[:TEST_FILES] + further


def part_of(file: str) -> list[str]:
    """Return all tests of a module's part: the folder of its room, without what is nearest already."""
    path, nearest = Path(file), nearest_tests(file)
    folder = ROOT / "tests" / path.parts[int(path.parts[0] == "heli_twin")]
    tests = [test.relative_to(ROOT).as_posix() for test in sorted(folder.rglob("test_*.py"))] if folder.is_dir() else []
    return [test for test in tests if test not in nearest]


def _tests_of(folder: Path, names: Sequence[str], imported: str) -> list[str]:
    """The test files in a folder that have one of these names, or name what they import; short ones first."""
    tests: list[tuple[int, int, str]] = []
    for test in folder.rglob("test_*.py"):
        text = test.read_text(encoding="utf-8")
        if test.name in names or re.search(rf"\b{re.escape(imported)}\b", text):
            near = names.index(test.name) if test.name in names else len(names)
            tests.append((near, len(text), test.relative_to(ROOT).as_posix()))
    return [test for *_, test in sorted(tests)]


PYTEST_WORDS = ["-W", "ignore::pytest.PytestAssertRewriteWarning"]
"""Plugins are already imported in a fork."""


def equivalent(mutation: Mutation) -> bool:
    kinds = [kind for kind in EQUIVALENT_KINDS if re.search(kind, mutation.after)]
    return (mutation.file, mutation.after) in EQUIVALENT or bool(kinds)


class Watch:
    """A pytest plugin: it tells which test runs, limits its processor time and leaves failures as they are."""

    def __init__(self, pipe: int):
        self.pipe = pipe

    def pytest_sessionstart(self):
        from hypothesis import Phase, settings

        settings.register_profile("mutants", settings.get_profile("ci"), phases=[Phase.explicit, Phase.generate])
        settings.load_profile("mutants")

    def pytest_runtest_logstart(self, nodeid: str):
        os.write(self.pipe, f"{nodeid}\n".encode())
        limit = int(time.process_time()) + TEST_CPU_LIMIT_S
        resource.setrlimit(resource.RLIMIT_CPU, (limit, resource.RLIM_INFINITY))


class Outcome(NamedTuple):
    """Of some tests: pytest's exit code, or a negative signal, and the last test begun."""

    code: int
    test: str


def tested(tests: Sequence[str]) -> Outcome:
    """Return the outcome of tests run to the first failure, in a fork of this process."""
    import pytest

    reader, writer = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reader)
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        code = 1
        try:
            code = int(
                pytest.main(["-x", "-q", "-p", "no:cacheprovider", *PYTEST_WORDS, *tests], plugins=[Watch(writer)])
            )
        finally:
            os._exit(code)
    os.close(writer)
    begun = b""
    while part := os.read(reader, 1 << 16):
        begun += part
    os.close(reader)
    lines = begun.decode().splitlines()
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return Outcome(code, lines[-1] if lines else "collection")


def copy_of_the_repository(folder: Path) -> None:
    for name in ("controllers", "heli_twin", "models", "tests"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, folder)
    # By the hash of the source: a mutant may have the size and the second of the original.
    words = [
        sys.executable,
        "-m",
        "compileall",
        "-q",
        "--invalidation-mode",
        "checked-hash",
        "controllers",
        "heli_twin",
    ]
    subprocess.run(words, cwd=folder, check=True)


def survivors(room: str, count: int, seed: int = 0) -> Iterator[tuple[Mutation, bool, str]]:
    """Yield of each sampled mutation whether it survives its tests, and the test that notices it.

    Raises:
        RuntimeError: A test that fails with a mutant fails without it too.
    """
    every = [mutation for file in modules(room) for mutation in mutations(file)]
    sample = random.Random(seed).sample(every, min(count, len(every)))
    nearest, sound = {mutation.file: nearest_tests(mutation.file) for mutation in sample}, set[str]()
    for mutation in sample:
        if equivalent(mutation):
            continue
        mutated = Path(mutation.file)
        original = mutated.read_text(encoding="utf-8")
        mutated.write_text(mutation.text, encoding="utf-8")
        tests = nearest[mutation.file]
        # Nothing notices what has no tests.
        outcome = tested(tests) if tests else Outcome(0, "")
        if outcome.code == 0 and (further := part_of(mutation.file)):
            outcome = tested(further)
        mutated.write_text(original, encoding="utf-8")
        test = "" if outcome.code == 0 else outcome.test
        if test and test not in sound:
            if tested([test] if "::" in test else ["--collect-only", *tests]).code != 0:
                raise RuntimeError(f"{test} of {tests} fails without a mutation too")
            sound.add(test)
        yield mutation, outcome.code == 0, test + " (out of time)" * (outcome.code == -signal.SIGXCPU)


def prepare(folder: Path) -> None:
    """Import the libraries, and go where the mutants are tested."""
    os.environ["OMP_NUM_THREADS"] = "1"
    os.environ["PYTHONPATH"] = str(folder)
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    sys.dont_write_bytecode = True
    for library in LIBRARIES.split():
        __import__(library)
    sys.path[0] = str(folder)
    os.chdir(folder)


def main(room: str, count: str = "50", seed: str = "0") -> None:
    """Print one line a mutant: its outcome, module, line, test and time; then, for survivors, both lines."""
    with tempfile.TemporaryDirectory() as name:
        copy_of_the_repository(Path(name))
        prepare(Path(name))
        began = time.monotonic()
        for mutation, survives, test in survivors(room, int(count), int(seed)):
            place = f"{time.monotonic() - began:4.0f} s  {mutation.file}:{mutation.line}"
            lines = f"\n    - {mutation.before}\n    + {mutation.after}"
            print(f"SURVIVES {place}{lines}" if survives else f"killed   {place}  {test}", flush=True)
            began = time.monotonic()


if __name__ == "__main__":
    main(*sys.argv[1:])
