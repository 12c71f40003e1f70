"""Commands that are printed for a person to paste mean the same words in a real shell, and run nothing else."""

import html
import json
import re
import subprocess
from functools import partial
from pathlib import Path

import hooks
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from heli_twin.cli import main
from heli_twin.studies.campaign import embedded, run_study
from heli_twin.studies.report import write_report
from heli_twin.studies.results import rows_of
from heli_twin.studies.study import Study, study_of, study_tree
from heli_twin.terminal_text import pasteable

HOSTILE = "my study $(touch pwned)`touch pwned`;touch pwned #'\"&\\!*"


def pasted(command: str, folder: Path) -> list[str]:
    """The arguments that a shell hands to `heli-twin`."""
    script = "heli-twin() { printf '%s\\0' \"$@\"; }\n" + command
    done = subprocess.run(["bash", "-c", script], cwd=folder, capture_output=True, timeout=10, check=True)
    assert done.stderr == b""
    return done.stdout.decode("utf-8", "surrogateescape").split("\0")[:-1]


@settings(max_examples=40)
@given(st.lists(st.text(st.characters(exclude_characters="\0"), max_size=50), min_size=1))
def test_a_shell_reads_the_words_that_were_written(words: list[str]) -> None:
    words = [word.encode("utf-8", "replace").decode() for word in words]
    command = pasteable("heli-twin", *words)
    assert command.isprintable()
    assert pasted(command, Path()) == words


def test_a_byte_that_is_no_text_stays_that_byte(tmp_path: Path) -> None:
    assert pasted(pasteable("heli-twin", "a\udcff\x1b[2J"), tmp_path) == ["a\udcff\x1b[2J"]


def test_a_file_is_never_an_option() -> None:
    assert pasteable("heli-twin", "replay", Path("-x.mcap")) == "heli-twin replay ./-x.mcap"


@pytest.fixture
def study(small: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    folder = Path(HOSTILE)
    swept = study_of(study_tree(small) | {"logs": {"worst": 0, "sampled": 0}})
    run_study(swept, folder, backend=partial(embedded, processes=1), work=partial(hooks.rough, 1.0))
    return folder


def test_the_commands_of_a_study_run_nothing_else_when_pasted(
    study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ids = {row["id"] for row in rows_of(study)}
    assert main(["study", "worst", str(study)]) == 0
    commands = [line.strip() for line in capsys.readouterr().out.splitlines() if line.startswith("    ")]
    assert len(commands) == len(ids)
    for command in commands:
        assert pasted(command, tmp_path)[0] in ("fly", "replay")
    page = write_report(study).read_text()
    specs = re.findall(r'application/json">(.*?)</script>', page, re.S)
    shown = {text for spec in specs for text in strings(json.loads(spec)) if text.startswith("heli-twin ")}
    shown |= {html.unescape(text) for text in re.findall(r"<code>(heli-twin .*?)</code>", page)}
    assert shown
    said = [pasted(command, tmp_path) for command in shown]
    assert {words[0] for words in said} == {"fly", "study"}
    for words in said:
        assert words[0] == "fly" or (words[1:3] == ["fly", HOSTILE] and words[3] in ids)
    assert {path.name for path in tmp_path.iterdir()} == {HOSTILE}


def strings(value: object) -> list[str]:
    """Every text in a tree of JSON."""
    if isinstance(value, str):
        return [value]
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return [text for one in inner for text in strings(one)]
