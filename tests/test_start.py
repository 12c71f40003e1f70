"""What a command loads: nothing heavy until it is needed."""

import subprocess
import sys

import pytest

HEAVY = (
    "numpy",
    "pydantic",
    "mujoco",
    "proxsuite",
    "rerun",
    "pyarrow",
    "matplotlib",
    "plotly",
    "optuna",
    "rich",
    "scipy",
)


def loaded(program: str) -> set[str]:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(done.stdout.rpartition("LOADED ")[2].split())


PROBE = "import sys\n{}\nprint('LOADED', *{{m.partition('.')[0] for m in sys.modules}})"


@pytest.mark.parametrize("word", ["--help", "fly --help"])
def test_help_loads_nothing_heavy(word):
    run = f"from heli_twin.cli import main\ntry: main({word.split()})\nexcept SystemExit: pass"
    assert not loaded(PROBE.format(run)) & {*HEAVY, "inspect"}


def test_importing_the_package_loads_nothing_heavy():
    assert not loaded(PROBE.format("import heli_twin")) & {*HEAVY}


def test_a_flight_loads_the_members_that_it_has_and_nothing_that_studies_and_pictures_need():
    run = "from heli_twin import fly, load\nfly(load('lab_simple', ['duration=0.02']), log_dir=None)"
    found = loaded(f"{PROBE.format(run)}\nprint(*sys.modules)")
    assert not found & {"rerun", "pyarrow", "matplotlib", "plotly", "optuna", "scipy", "duckdb"}
    # The external law is also what a flight asks for its program.
    members = {name for name in found if name.startswith(("controllers.laws.", "heli_twin.lab.faults."))}
    assert members == {"controllers.laws.ltv_mpc", "controllers.laws.external"}


def test_a_worker_loads_no_scipy_for_a_study_without_requirements():
    run = "import heli_twin.studies.columns, heli_twin.studies.work"
    assert not loaded(PROBE.format(run)) & {"rerun", "pyarrow", "matplotlib", "plotly", "optuna", "scipy", "duckdb"}
