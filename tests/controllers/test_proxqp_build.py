"""Which build of ProxSuite runs decides the last digits: one process can load one, so each case has its own."""

import json
import subprocess
import sys

import pytest

FLIGHT = """
import json, sys, warnings
{first}
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    from heli_twin import fly, load
    result = fly(load("lab", ["duration=0.1"]), log_dir=None)
from controllers.proxqp import BUILD
import proxsuite.instructionset
said = [str(w.message) for w in caught if "ProxSuite" in str(w.message)]
build, cpu = result.log.metadata["proxsuite_build"], proxsuite.instructionset.__file__
print(json.dumps([BUILD, build, result.solver_trouble, result.summary()["solver_trouble"], said, cpu]))
"""
WIDE = "import proxsuite; wide = proxsuite.proxqp.__name__ != 'proxsuite.proxsuite_pywrap.proxqp'"


def flown(first: str) -> list:
    done = subprocess.run(
        [sys.executable, "-c", FLIGHT.format(first=first)], capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


def test_the_plain_build_runs_and_no_stub_is_left_behind():
    build, logged, trouble, summary, said, cpu = flown("")
    assert (build, logged, trouble, summary, said) == ("plain", "plain", "", None, [])
    assert cpu.endswith(".so")


def test_another_build_that_was_imported_first_is_said_everywhere():
    is_wide = subprocess.run(
        [sys.executable, "-c", f"{WIDE}\nsys = __import__('sys').exit(wide)"], check=False
    ).returncode
    if not is_wide:
        pytest.skip("this processor runs the plain build anyway")
    build, logged, trouble, summary, said, cpu = flown("import proxsuite")
    assert build == logged != "plain"
    assert f"runs its {build} build" in trouble
    assert [trouble] == said == [summary]
    assert cpu.endswith(".so")
