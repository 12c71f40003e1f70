"""A Dask cluster whose members have certificates, started as the README says, by real commands on loopback."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from heli_twin import HeliTwinError
from heli_twin.studies.results import rows_of

dask = pytest.importorskip("dask")
pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("ignore")
OPENSSL = ("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")


def configuration(folder: Path, name: str) -> Path:
    """Dask's configuration with a throw-away certificate that is its own authority."""
    key, certificate = folder / f"{name}.key", folder / f"{name}.pem"
    words = [*OPENSSL, "-keyout", key, "-out", certificate, "-days", "1", "-subj", f"/CN={name}"]
    subprocess.run(words, check=True, capture_output=True)
    pair = {"cert": str(certificate), "key": str(key)}
    tls = {"ca-file": str(certificate), "scheduler": pair, "worker": pair, "client": pair}
    file = folder / f"{name}.yaml"
    # JSON is YAML.
    file.write_text(json.dumps({"distributed": {"comm": {"require-encryption": True, "tls": tls}}}))
    return file


def environment(settings: Path) -> dict[str, str]:
    return os.environ | {"DASK_CONFIG": str(settings), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


@pytest.fixture(scope="module")
def mine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return configuration(tmp_path_factory.mktemp("certificates"), "mine")


@pytest.fixture(scope="module")
def address(mine: Path) -> Iterator[str]:
    folder, file = mine.parent, mine.parent / "scheduler.json"
    scheduler = [
        "dask",
        "scheduler",
        "--protocol",
        "tls",
        "--host",
        "127.0.0.1",
        "--port",
        "0",
        "--scheduler-file",
        file,
    ]
    with ExitStack() as processes:

        def start(*words: str | Path) -> None:
            options = {"cwd": folder, "env": environment(mine), "stderr": subprocess.DEVNULL}
            process = subprocess.Popen([Path(sys.executable).with_name(str(words[0])), *words[1:]], **options)
            processes.callback(process.wait)
            processes.callback(process.terminate)

        start(*scheduler, "--no-dashboard")
        deadline = time.monotonic() + 60
        while not file.exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        address = json.loads(file.read_text())["address"]
        start("dask", "worker", address, "--nthreads", "1", "--nworkers", "1", "--no-dashboard")
        yield address


def study(address: str, folder: Path, settings: Path) -> subprocess.CompletedProcess[str]:
    (folder / "two.toml").write_text('name = "two"\nreplicates = 2\n[base]\npreset = "ideal"\nduration = 2.6\n')
    words = ["study", "run", "two.toml", "--no-report", "--out", "out", "--scheduler", address]
    command, streams = [sys.executable, "-m", "heli_twin", *words], {"capture_output": True, "text": True}
    return subprocess.run(command, cwd=folder, env=environment(settings), timeout=100, check=False, **streams)


def test_a_study_flies_on_an_encrypted_cluster(address: str, mine: Path, tmp_path: Path) -> None:
    assert address.startswith("tls://127.0.0.1:")
    done = study(address, tmp_path, mine)
    assert done.returncode == 0, done.stderr
    assert {row["outcome"] for row in rows_of(tmp_path / "out")} == {"completed"}


@pytest.mark.parametrize(
    ("who", "scheme", "sentence"),
    [
        ("nobody", "tls", "needs certificates: set ca-file, client.cert and client.key"),
        ("stranger", "tls", "TLS certificate does not match"),
        ("mine", "tcp", "requires encryption, and tcp://"),
        ("keyless", "tls", r"cannot be used: \[Errno 2\]"),
    ],
)
def test_without_the_right_certificate_there_is_one_sentence(
    who: str, scheme: str, sentence: str, address: str, mine: Path, tmp_path: Path
) -> None:
    from heli_twin.workers.dask_cluster import DaskCluster

    settings = (
        {} if who == "nobody" else json.loads((mine if who == "mine" else configuration(tmp_path, who)).read_text())
    )
    (tmp_path / "keyless.key").unlink(missing_ok=True)
    with dask.config.set(dask.config.merge(dask.config.config, settings)), pytest.raises(HeliTwinError, match=sentence):
        DaskCluster(address.replace("tls", scheme))
