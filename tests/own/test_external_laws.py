"""A law in another process: lock-stepped, never faster or slower in the flight, and its failures are nobody's crash."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers import programs
from controllers.fallback import safe_hover
from controllers.laws import closed_after
from controllers.laws.external import LIMIT_VARIABLE, External, _inputs, limit_from_environment
from controllers.line_process import LineProcess, ProcessFailed
from controllers.model import Model
from controllers.signals import Command, Estimate, Reference
from heli_twin import Experiment, HeliTwinError, fly, load, read_log
from heli_twin.cli import main
from heli_twin.conformance import CHECKS
from heli_twin.experiment.tree import canonical_json, from_json
from heli_twin.flight import Flight
from heli_twin.mission import Result
from heli_twin.recording import Recorder

GUIDE = (Path(__file__).parents[2] / "heli_twin/guide/external-laws.md").read_text(encoding="utf-8")
SHORT = ["duration=0.6", "trajectory=hover", "controller=external"]
COMPILE = ("-O2", "-ffp-contract=off")


@pytest.fixture(autouse=True)
def nothing_named() -> Iterator[None]:
    """What one test names is unknown to the next."""
    forget()
    yield
    forget()


def forget() -> None:
    """As in a new process."""
    programs._named.clear()
    programs._supplied.clear()


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pid.py").write_text(example("python"))
    return tmp_path


def example(language: str) -> str:
    """The example of the guide in a language."""
    blocks = re.findall(rf"```{language}\n(.*?)```", GUIDE, re.DOTALL)
    return next(block for block in blocks if "Our PID as a program" in block)


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The C example of the guide, compiled."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("there is no C compiler")
    folder = tmp_path_factory.mktemp("c")
    (folder / "pid.c").write_text(example("c"))
    command = [compiler, *COMPILE, "-Wall", "-Wextra", "-Wno-unused-result", "-Werror"]
    subprocess.run([*command, "pid.c", "-o", "pid", "-lm"], cwd=folder, check=True)
    return folder / "pid"


def flown(*command: str | Path, changes: tuple[str, ...] = ()) -> Result:
    words = json.dumps([str(word) for word in command])
    return fly(load("lab", [*SHORT, f"controller.command={words}", *changes]), log_dir=None)


def wires(result: Result) -> dict[str, list[bytes]]:
    return {name: list(topic.data) for name, topic in result.log.messages.items() if name != "/timing"}


FLIES = "print(now, 0, 0, 0.545, 0, flush=True)"


def script(folder: Path, misdeed: str = "", greeting: str = "print('heli_twin 1', flush=True)") -> list[str]:
    """A law that hovers, and does something else in its twentieth step."""
    text = (
        f"import os, sys, time\nsys.stdin.readline()\n{greeting}\nfor line in sys.stdin:\n    now = line.split()[0]\n"
    )
    text += f"    if int(now) == 400_000_000:\n        {misdeed or FLIES}\n    else:\n        {FLIES}\n"
    (folder / "law.py").write_text(text)
    return ["python3", "law.py"]


@pytest.mark.parametrize("trajectory", ["circle", "hover"])
def test_the_examples_fly_as_our_pid_to_the_last_digit(here: Path, compiled: Path, trajectory: str) -> None:
    changes = (f"trajectory={trajectory}", "duration=4")
    ours = wires(fly(load("lab", ["controller=pid", *changes]), log_dir=None))
    assert wires(flown(compiled, changes=changes)) == ours
    assert wires(flown("python3", "pid.py", changes=changes)) == ours


def test_the_speed_of_the_process_does_not_change_a_flight(here: Path, compiled: Path) -> None:
    alone = {flown(compiled).flight_digest}, {flown("python3", "pid.py").flight_digest}
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2 * (os.cpu_count() or 1))]
    try:
        loaded = {flown(compiled).flight_digest}, {flown("python3", "pid.py").flight_digest}
    finally:
        for process in busy:
            process.kill()
            process.wait()
    assert loaded == alone
    # A program that is slow in one step is another program with another digest, and flies the same flight.
    slow = wires(flown(*script(here, f"time.sleep(1); {FLIES}")))
    assert slow == wires(flown(*script(here)))


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        ("os.kill(os.getpid(), 9)", "it was ended by SIGKILL"),
        ("sys.exit(3)", "it ended with exit code 3"),
        ("1 / 0", "it ended with exit code 1; its last words were 'ZeroDivisionError: division by zero'"),
        ("os.close(1); time.sleep(60)", "it closed its input or output and went on"),
        ("time.sleep(60)", "it did not answer within 2 s: does it flush its output after each line?"),
        ("print(now, 0, 0, 0.5, 0)", "it did not answer within 2 s"),
        ("while True: sys.stderr.write('oh, time.sleep ' * 99)", "it did not answer within 2 s"),
        ("print('GARBAGE', 1, 2, 3, 4, flush=True)", "it answered what is no row of numbers: 'GARBAGE 1 2 3 4'"),
        ("os.write(1, bytes(range(128, 160)) + b' 1 2 3 4\\n')", r"it answered what is no row of numbers: '\\x80\\x81"),
        ("print(now, 0, 0, 0.5, flush=True)", "it has to answer with 5 numbers, not 4: "),
        ("print(now, 0, 0, 0.5, 0, 0, flush=True)", "it has to answer with 5 numbers, not 6: "),
        ("print(flush=True)", "it has to answer with 5 numbers, not 0: ''"),
        ("print(now, 0, 'nan', 0.5, 0, flush=True)", "its roll input is nan, and full stick is -1 to 1"),
        ("print(now, 0, 0, 1.5, 0, flush=True)", "its thrust input is 1.5, and full stick is -1 to 1"),
        ("print(now, 0, 0, 0.5, '-inf', flush=True)", "its yaw input is -inf"),
        ("print(0, 0, 0, 0.5, 0, flush=True)", "its answer has to begin with the control time that it was sent, "),
        ("print('x' * 5000, flush=True)", "it sent a line of more than 1000 bytes"),
        ("os.write(1, b'1' * 3000); time.sleep(60)", "it sent more than 1000 bytes without a line break"),
        ("print(now, 0, 0, 0.5, 0, end='\\n\\n', flush=True)", "it sent more than the one line"),
    ],
)
def test_a_failed_process_makes_the_run_invalid(
    here: Path, monkeypatch: pytest.MonkeyPatch, answer: str, reason: str
) -> None:
    monkeypatch.setenv(LIMIT_VARIABLE, "2")
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    result = flown(*script(here, answer))
    assert result.outcome.kind == "invalid"
    assert f"law.py failed as a control law at 0.40 s: {reason}" in result.outcome.text
    assert len(result.outcome.text) < 500
    assert str(here) not in result.outcome.text
    assert (result.flight_digest, result.log.digest, result.log.outcome) == ("", "", "invalid")
    assert result.log.ending.text == result.outcome.text


@pytest.mark.parametrize(
    ("greeting", "reason"),
    [
        ("print('ready', flush=True)", "it has to answer the first line with 'heli_twin 1', not 'ready'"),
        ("print('heli_twin 2', flush=True)", "it has to answer the first line with 'heli_twin 1', not 'heli_twin 2'"),
        ("sys.exit('no such gain')", "it ended with exit code 1; its last words were 'no such gain'"),
    ],
)
def test_a_process_that_does_not_begin_well_is_told(here: Path, greeting: str, reason: str) -> None:
    result = flown(*script(here, greeting=greeting))
    assert result.outcome.kind == "invalid"
    assert reason in result.outcome.text


def test_what_cannot_be_executed_is_told(here: Path) -> None:
    """A script whose interpreter is not here; the kernel finds out when it starts it."""
    (here / "law").write_text("#!/no/such/interpreter\n")
    (here / "law").chmod(0o755)
    text = flown("./law").outcome.text
    assert re.match(r"law failed as a control law at 0.02 s: it (ended with exit code 127|cannot be started)", text)
    assert "No such file or directory" in text
    assert str(here) not in text


def test_of_a_path_in_its_last_words_the_name_of_the_file_is_told(here: Path) -> None:
    result = flown(*script(here, greeting=f"sys.exit('cannot read {here}/law.py')"))
    assert "its last words were 'cannot read law.py'" in result.outcome.text


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("[]", "controller.command is empty: name the program"),
        ("./nowhere", "controller.command[0] = './nowhere': there is no such file"),
        ("nowhere", "controller.command[0] = 'nowhere': there is no such program on the search path; name a file"),
        ("pid.py", "there is no such program on the search path; write ./pid.py"),
        ("./pid.py", "controller.command[0] = './pid.py' is not executable: chmod +x it"),
        ('["python3", "/no/law.py"]', "controller.command[1] = '/no/law.py': a path has to name a file"),
        ('["python3", "--config=/etc/x"]', "a path has to name a file, whose content is logged in its place"),
        ('["python3", "a\\u0007b"]', "a path has to name a file, whose content is logged in its place"),
        ('["."]', "controller.command[0] = '.': there is no such program"),
        ('["./"]', "controller.command[0] = './': there is no such file"),
        ("pid@0123456789abcdef", "says what a program is and not where, since no program is run"),
        ("3", "controller.command = 3: it must be"),
    ],
)
def test_a_command_that_cannot_be_run_is_refused(
    here: Path, command: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fly", *SHORT, f"controller.command={command}", "--log-dir", "logs"]) == 2
    assert message in capsys.readouterr().err
    assert not (here / "logs").exists()


def test_the_limit_has_to_be_a_time(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for text in ("soon", "0", "-1", "nan", "inf", "3601"):
        monkeypatch.setenv(LIMIT_VARIABLE, text)
        with pytest.raises(HeliTwinError, match=rf"{LIMIT_VARIABLE} is '{text}'.*at most 3600; without it .* 10 s"):
            flown(*script(here))
    monkeypatch.setenv(LIMIT_VARIABLE, "3600")
    assert limit_from_environment() == 3600.0
    monkeypatch.delenv(LIMIT_VARIABLE)
    assert limit_from_environment() == 10.0


def test_a_program_that_never_reads_holds_nobody_up() -> None:
    """A line that is longer than a pipe can hold."""
    process = LineProcess([sys.executable, "-c", "import time; time.sleep(60)"], 0.3)
    with closing(process), pytest.raises(ProcessFailed, match=r"within 0\.3 s"):
        process.ask("x" * 1_000_000)


def test_a_program_that_reads_the_end_of_its_input_has_time_to_end(tmp_path: Path) -> None:
    late = "import pathlib, sys, time; sys.stdin.read(); time.sleep(0.3); pathlib.Path(sys.argv[1]).touch()"
    LineProcess([sys.executable, "-c", late, str(tmp_path / "saved")], 1.0).close()
    assert (tmp_path / "saved").exists()


def test_a_program_that_changed_since_it_was_named_is_refused(here: Path) -> None:
    experiment = load("lab", [*SHORT, 'controller.command=["python3", "pid.py"]'])
    (here / "pid.py").write_text("another")
    with pytest.raises(HeliTwinError, match="has changed since it was named"):
        fly(experiment, log_dir=None)


def test_an_experiment_holds_no_path_and_the_hash_of_the_program(here: Path) -> None:
    by_object = Experiment(controller=External(command=("python3", str(here / "pid.py"), "--gain", "2")))
    text = canonical_json(by_object)
    assert str(here) not in text
    python, name, *rest = json.loads(text)["controller"]["command"]
    assert (python, name.partition("@")[0], rest) == ("python3@PATH", "pid.py", ["--gain", "2"])
    by_text = load("lab", ["controller=external", 'controller.command=["python3", "pid.py", "--gain", "2"]'])
    assert by_text == by_object == from_json(text)
    (here / "pid.py").write_text("another")
    assert External(command=("python3", "pid.py", "--gain", "2")) != by_object.controller


def test_a_file_in_toml_stands_beside_the_toml(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "x.toml").write_text('duration = 1\n[controller]\nkind = "external"\ncommand = ["python3", "pid.py"]\n')
    (here / "law").write_text("#!/usr/bin/env python3\n" + example("python"))
    (here / "law").chmod(0o755)
    here_too = load("x.toml", ["controller.command=./law"])
    (here / "y.toml").write_text('duration = 1\n[controller]\nkind = "external"\ncommand = "./law"\n')
    assert load("y.toml") == here_too
    monkeypatch.chdir("/")
    assert load(str(here / "y.toml")) == here_too
    assert fly(load(str(here / "x.toml")), log_dir=None).outcome.kind == "completed"


def test_nothing_is_run_because_a_log_says_so(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fly", *SHORT, 'controller.command=["python3", "pid.py"]', "--log-dir", "logs"]) == 0
    (run,) = (here / "logs").glob("*.mcap")
    facts = json.dumps([read_log(run).experiment, dict(read_log(run).metadata)])
    assert str(here) not in facts
    assert "pid.py@" in facts
    forget()
    for command in ("refly", "resolve"):
        assert main([command, str(run)]) == 2
        assert "--with ./pid where a log or a store is read" in capsys.readouterr().err
    assert main(["reestimate", str(run)]) == 0
    assert main(["info", str(run)]) == 0
    with_it = ["--with", '["python3", "pid.py"]']
    capsys.readouterr()
    assert main(["refly", str(run), *with_it]) == 0
    assert main(["resolve", str(run), *with_it]) == 0
    out = capsys.readouterr().out
    assert "identical" in out
    assert "was flown by" not in out
    (here / "pid.py").write_text(example("python").replace("1.0, 0.39)", "1.1, 0.39)"))
    forget()
    assert main(["refly", str(run), *with_it]) == 1
    assert "controller was flown by the program 'python3@PATH pid.py@" in capsys.readouterr().out
    hostile = read_log(run).experiment.replace('["python3@PATH"', '["touch"')
    with pytest.raises(HeliTwinError, match="no program is run because they say so"):
        from_json(hostile)


def test_an_invalid_run_is_kept_shown_and_flown_again(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = script(here, "sys.exit(3)")
    command = f"controller.command={json.dumps(words)}"
    assert main(["fly", *SHORT, command, "--log-dir", "logs"]) == 3
    out = capsys.readouterr().out
    assert out.startswith("invalid: law.py failed as a control law at 0.40 s: it ended with exit code 3")
    assert "no digest" in out
    (run,) = (here / "logs").glob("*.mcap")
    assert main(["info", str(run), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["outcome"], facts["digest"]) == ("invalid", "")
    assert main(["replay", str(run), "--save", "x.rrd"]) == 0
    script(here)
    assert main(["refly", str(run), "--with", json.dumps(words)]) == 0
    assert "identical" in (out := capsys.readouterr().out)
    assert "as far as the log of the invalid run goes, 0.40 s" in out
    script(here, "sys.exit(3)")
    assert main(["refly", str(run), "--with", json.dumps(words)]) == 3
    assert main(["fly", *SHORT, command, "--no-log", "--json"]) == 3
    summary: dict[str, Any] = json.loads(capsys.readouterr().out.rpartition("exit code 3\n")[2])
    assert (summary["outcome"], summary["flight_digest"]) == ("invalid", None)


@pytest.mark.parametrize("check", CHECKS["controllers.laws"], ids=lambda check: check.__name__)
def test_the_c_example_keeps_the_rules_of_a_law(compiled: Path, check: Any) -> None:
    check(External(command=(str(compiled),)))


def test_check_judges_a_program(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", '["python3", "pid.py"]']) == 0
    capsys.readouterr()
    assert main(["check", json.dumps(script(here, "print(now, 2, 0, 0, 0, flush=True)")), "--json"]) == 1
    troubles = [row["trouble"] for row in json.loads(capsys.readouterr().out) if row["trouble"]]
    assert len(troubles) == 2
    assert all("its pitch input is 2, and full stick is -1 to 1: clip it there" in trouble for trouble in troubles)
    assert main(["check", "./nowhere"]) == 2
    assert "there is no such file" in capsys.readouterr().err


STUBBORN = """
import os, signal, sys, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
sys.stdin.readline()
print("heli_twin 1", flush=True)
open("pid", "w").write(str(os.getpid()))
while True:
    time.sleep(1)
"""
"""Says nothing and reads nothing after the first line, not even the end of file."""


def ended(process: int, within: float = 8.0) -> bool:
    """Whether a process ends within so many seconds."""
    due = time.monotonic() + within
    while time.monotonic() < due:
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return True
        # One that waits for its parent to notice has ended.
        if Path(f"/proc/{process}/stat").exists() and Path(f"/proc/{process}/stat").read_text().split()[2] == "Z":
            return True
        time.sleep(0.05)
    return False


def begun(folder: Path) -> int:
    """The process of a law that writes its number when it has begun."""
    due = time.monotonic() + 30.0
    while not (folder / "pid").exists() or not (folder / "pid").read_text():
        assert time.monotonic() < due
        time.sleep(0.02)
    return int((folder / "pid").read_text())


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_no_process_outlives_a_flight(here: Path, number: int, code: int) -> None:
    (here / "law.py").write_text(STUBBORN)
    words = [*SHORT, 'controller.command=["python3", "law.py"]', "--log-dir", "logs"]
    flight = subprocess.Popen(
        [sys.executable, "-m", "heli_twin", "fly", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    law = begun(here)
    flight.send_signal(number)
    assert flight.wait(timeout=5) == code
    if number == signal.SIGKILL and shutil.which("setpriv") is None:
        os.kill(law, signal.SIGKILL)
    assert ended(law)
    flight.communicate()


def test_a_process_that_goes_on_after_the_flight_is_ended(here: Path) -> None:
    text = "import os, sys, time\nsys.stdin.readline()\nprint('heli_twin 1', flush=True)\n"
    text += "open('pid', 'w').write(str(os.getpid()))\n"
    text += f"for line in sys.stdin:\n    now = line.split()[0]\n    {FLIES}\ntime.sleep(60)\n"
    (here / "law.py").write_text(text)
    assert flown("python3", "law.py").outcome.kind == "completed"
    assert ended(begun(here), within=0.1)


def test_a_talkative_standard_error_blocks_nothing(here: Path) -> None:
    assert flown(*script(here, f"sys.stderr.write('x' * 1_000_000); {FLIES}")).outcome.kind == "completed"


WITNESS = f"""
import sys
lines = open("lines", "w")
lines.write(sys.stdin.readline())
print("heli_twin 1", flush=True)
for line in sys.stdin:
    lines.write(line)
    lines.flush()
    now = line.split()[0]
    {FLIES}
"""


def test_every_number_that_it_is_sent_is_the_logged_one(here: Path) -> None:
    (here / "law.py").write_text(WITNESS)
    log = flown("python3", "law.py", changes=("trajectory=circle", "controller.steps=3")).log
    hello, *lines = (here / "lines").read_text().splitlines()
    assert hello.split()[:7] == ["heli_twin", "1", "0.02", "3", "8", "4", "0"]
    model = External().model
    assert [float(word) for word in hello.split()[7:]] == [*model.u_min, *model.u_max, *model.u_hover]
    sent = np.array([[float(word) for word in line.split()] for line in lines])
    estimate = log.estimate
    assert sent.shape == (len(estimate.time), 28 + 4 * 8 + 3 * 4)
    believed = [estimate.time, estimate.stamp, *estimate.x.T, *estimate.disturbance.T]
    believed += [*estimate.variance.reshape(len(sent), -1).T, estimate.pose_stamp, estimate.rejected]
    assert np.array_equal(sent[:, :28], np.array(believed).T)
    # What is ahead now is the beginning three periods later.
    assert np.array_equal(sent[:-3, 28 + 3 * 8 : 28 + 4 * 8], sent[3:, 28 : 28 + 8])
    assert np.array_equal(sent[:-2, 60 + 2 * 4 :], sent[2:, 60 : 60 + 4])


def test_further_states_of_an_estimator_are_at_the_end(here: Path) -> None:
    (here / "law.py").write_text(WITNESS)
    law = External(command=("python3", "law.py"))
    reference = Reference(0, np.ones((2, 8)), np.zeros((1, 4)))
    numbers = np.zeros(8), np.zeros(4), np.zeros((4, 3)), -1, 0, np.array([0.1, 0.2]), np.array([3.0, 4.0])
    with closed_after(law.start()) as controller:
        controller.step(20_000_000, Estimate(0, *numbers), reference)
        hello, line = (here / "lines").read_text().splitlines()
    assert hello.split()[6] == "2"
    assert line.split()[48:] == ["0.1", "0.2", "3.0", "4.0"]


def test_without_a_finite_estimate_it_is_not_asked(here: Path) -> None:
    law = External(command=tuple(script(here, greeting="sys.exit()")))
    lost = Estimate(0, np.full(8, np.nan), np.zeros(4), np.zeros((4, 3)), -1, 0)
    with closed_after(law.start()) as controller:
        command = controller.step(0, lost, Reference(0, np.ones((2, 8)), np.zeros((1, 4))))
    assert command.u.tolist() == list(law.model.u_hover)


@given(st.text(st.characters(codec="ascii"), max_size=80) | st.lists(st.floats(), min_size=4, max_size=6).map(repr))
def test_any_answer_is_four_inputs_or_refused_in_one_sentence(answer: str) -> None:
    try:
        inputs, reason = _inputs(answer, 20), ""
    except ProcessFailed as error:
        inputs, reason = np.zeros(4), str(error)
    assert inputs.shape == (4,)
    assert (np.abs(inputs) <= 1.0).all()
    assert len(reason) < 300
    assert _inputs("20.0 -1 1 0.5 1e-3\r", 20).tolist() == [-1.0, 1.0, 0.5, 0.001]


@dataclass(frozen=True, slots=True)
class Held:
    """A law of a user's own that holds something and is interrupted in its tenth step."""

    kind: Literal["held"] = "held"
    period: float = 0.02
    error: type[BaseException] = KeyboardInterrupt
    steps: int = 1
    model: Model = field(default_factory=Model)

    def start(self) -> "Held":
        RELEASED.clear()
        return self

    def step(self, now: int, estimate: Estimate, reference: Reference) -> Command:
        if now >= 200_000_000:
            raise self.error
        return safe_hover(self.model, now)

    def explain(self, command: Command) -> Command:
        return command

    def close(self) -> None:
        RELEASED.append(self)


RELEASED: list[Held] = []


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError])
def test_any_law_that_can_be_closed_is_closed(error: type[BaseException]) -> None:
    plant, recorder = Experiment().plant.start(np.array([0.0, 0, 1, 0, 0, 0, 0, 0])), Recorder()
    law = Held(error=error)
    with pytest.raises(error):
        Flight(replace(load("lab", SHORT[:2]), controller=law), plant, recorder).run()
    assert [law] == RELEASED


@pytest.mark.parametrize(
    ("mode", "may_be_run"), [(0o644, False), (0o666, False), (0o744, True), (0o654, True), (0o645, True)]
)
def test_a_file_that_anybody_may_run_is_sent_as_one(tmp_path, mode, may_be_run):
    file = tmp_path / "law"
    file.write_bytes(b"#!/bin/sh\n")
    file.chmod(mode)
    assert programs._file(0, file) == (0, may_be_run, b"#!/bin/sh\n")
