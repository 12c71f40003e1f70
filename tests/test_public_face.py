"""The public face: what `import heli_twin` offers, teaches and loads."""

import os
import pydoc
import subprocess
import sys
from pathlib import Path

import pytest

import heli_twin

ROOT = Path(__file__).parents[1]


def python(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, *words]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=60)


@pytest.mark.parametrize("name", heli_twin.__all__)
def test_every_public_name_is_there_and_explained(name: str) -> None:
    assert name in dir(heli_twin)
    assert getattr(heli_twin, name).__doc__


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'heli_twin' has no attribute 'flie'"):
        _ = heli_twin.flie


def test_help_teaches_the_face_in_a_screen() -> None:
    screen = "\n".join(pydoc.plain(pydoc.render_doc(heli_twin)).splitlines()[:40])
    for name in heli_twin.__all__:
        assert name in screen, name
    assert "Everything else may change." in screen


def test_the_import_loads_nothing_heavy(tmp_path: Path) -> None:
    heavy = ("numpy", "mujoco", "rerun", "pydantic", "proxsuite", "rich", "mcap", "matplotlib")
    done = python(tmp_path, "-c", f"import sys, heli_twin; print([m for m in {heavy} if m in sys.modules])")
    assert (done.stdout, done.stderr) == ("[]\n", "")


@pytest.mark.parametrize("file", ["controllers.py", "controllers/__init__.py"])
def test_a_package_that_hides_ours_is_named(file: str, tmp_path: Path) -> None:
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_text("")
    (tmp_path / "mine.py").write_text("import heli_twin\n")
    sentence = (
        f"{(tmp_path / file.removesuffix('/__init__.py')).resolve()} hides the package 'controllers' of heli_twin"
    )
    script, module = python(tmp_path, "mine.py"), python(tmp_path, "-m", "heli_twin", "fly")
    assert sentence in script.stderr.splitlines()[-1]
    assert sentence in module.stderr
    assert module.stderr.count("\n") == 1
    assert script.returncode == module.returncode == 1


def test_a_folder_that_is_no_package_hides_nothing(tmp_path: Path) -> None:
    (tmp_path / "controllers").mkdir()
    assert python(tmp_path, "-c", "import heli_twin; heli_twin.Experiment()").returncode == 0
