"""The proof of the sequential planner with flown helicopters, and that it can be stopped and goes on where it was."""

from pathlib import Path

import pytest
import room_proof
from room_proof import Case, cases, prove, table, trouble

GOOD = {
    "least": 0.41,
    "planned": 0.45,
    "promised": 0.45,
    "arrived": 2,
    "ships": 2,
    "time": 4.0,
    "outcomes": {},
    "cpu": 1.0,
}


@pytest.mark.long
@pytest.mark.parametrize("group", dict.fromkeys(case.group for case in cases()))
def test_nobody_comes_near_and_all_arrive(group: str, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture):
    """Stopped, `pytest -m long` goes on where it was."""
    path = Path(request.config.cache.mkdir("room_proof")) / "results.jsonl"
    with capsys.disabled():
        results = prove(path, group)
    assert {case: why for case, result in results.items() if (why := trouble(case, result))} == {}


def test_a_proof_goes_on_where_it_was_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    flights = [Case(f"group {i % 2}", "pair", (f"seed={i}",), (1.0,)) for i in range(4)]
    done: list[Case] = []
    monkeypatch.setattr(room_proof, "cases", lambda: flights)
    monkeypatch.setattr(room_proof, "flown", lambda case: done.append(case) or GOOD)
    path = tmp_path / "results.jsonl"
    assert list(prove(path, "group 1", "code")) == flights[1::2]
    with path.open("a") as file:
        file.write('\n{"code": "code", "case": "pair see')
    results = prove(path, "", "code")
    assert done == [*flights[1::2], *flights[::2]]
    assert list(results) == flights
    assert prove(path, "", "code") == results
    assert len(done) == 4
    prove(path, "", "other code")
    assert len(done) == 8
    assert "| group 0 | 2 | 0.410 | 0.450 | 4.0, 4.0 | none |" in table(results)


@pytest.mark.parametrize(
    ("result", "why"),
    [
        ({}, ""),
        ({"least": 0.29}, "0.290 m apart"),
        ({"planned": 0.449}, "plans 0.4490 m apart"),
        ({"arrived": 1}, "1 of 2 arrived"),
    ],
)
def test_a_flight_fails_when_two_come_near_or_one_does_not_arrive(result: dict, why: str):
    assert trouble(Case("", "", (), ()), GOOD | result) == why


def test_who_has_an_emergency_lands_and_nobody_else():
    case = Case("", "", (), (), "a")
    assert trouble(case, GOOD | {"arrived": 1, "outcomes": {"a": "landed"}}) == ""
    assert trouble(case, GOOD) == "outcomes {}"
    assert trouble(case, GOOD | {"outcomes": {"a": "landed", "b": "crashed"}}).startswith("outcomes")
