"""Robustness: RTAMT, an independent tool, judges 1000 random formulas; the descent to the tightest moment is exact."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from heli_twin.requirements.formula import Below, Formula, Trace
from heli_twin.requirements.parser import parse

CASES = [json.loads(line) for line in (Path(__file__).parent / "rtamt_verdicts.jsonl").read_text().splitlines()]
UNITS = {"x": "", "y": "", "on": None}


def one(_: Below) -> float:
    return 1.0


def trace(**signals: list[float]) -> Trace:
    columns = {name: np.array(values) for name, values in signals.items()}
    return Trace(1.0, len(next(iter(columns.values()))), columns)


def robustness(text: str, period: float = 1.0, **signals: list[float]) -> list[float]:
    return parse(text, UNITS).robustness(trace(**signals)._replace(period=period), one).tolist()


def test_rtamt_computes_the_same_robustness() -> None:
    assert len(CASES) == 1000
    for case in CASES:
        ours = robustness(case["formula"], x=case["x"], y=case["y"])
        assert ours == [float(value) for value in case["robustness"]], case


def value_at_the_tightest(formula: Formula, on: Trace, at: int) -> float | None:
    decides = formula.tightest(at, on, one)
    return None if decides is None else float(decides.leaf.robustness(on, one)[decides.sample])


def test_the_tightest_moment_has_the_value_of_the_formula() -> None:
    decided = 0
    for case in CASES:
        formula, on = parse(case["formula"], UNITS), trace(x=case["x"], y=case["y"])
        for at, value in enumerate(formula.robustness(on, one)):
            told = value_at_the_tightest(formula, on, at)
            if told is None:
                assert np.isinf(value)
            else:
                assert abs(told) == abs(value)
                decided += 1
    assert decided > 5000


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x < 3", [2.0, 1.0, -2.0, 4.0]),
        ("3 > x", [2.0, 1.0, -2.0, 4.0]),
        ("abs(x) <= 2", [1.0, 0.0, -3.0, 1.0]),
        ("0 < x < 3", [1.0, 1.0, -2.0, -1.0]),
        ("x < 300 %", [2.0, 1.0, -2.0, 4.0]),
        ("on implies x < 3", [np.inf, 1.0, -2.0, np.inf]),
        ("always[1s,2s] x < 3", [-2.0, -2.0, 4.0, np.inf]),
        ("eventually[1s,2s] x < 3", [1.0, 4.0, 4.0, -np.inf]),
        ("always[2s,end] x < 3", [-2.0, 4.0, np.inf, np.inf]),
        ("(x < 3) until on", [2.0, np.inf, np.inf, -np.inf]),
    ],
)
def test_known_values(text, expected) -> None:
    assert robustness(text, x=[1.0, 2.0, 5.0, -1.0], on=[False, True, True, False]) == expected


@pytest.mark.parametrize(
    ("interval", "samples"), [("[0.24s,0.26s]", (1, 1)), ("[100 ms,end]", (0, 3)), ("[1s,9s]", (4, 3))]
)
def test_intervals_are_rounded_to_the_nearest_sample_and_end_with_the_flight(interval, samples) -> None:
    formula = parse(f"always{interval} x < 3", UNITS)
    assert formula.interval.samples(trace(x=[0.0] * 4)._replace(period=0.25)) == samples


def test_a_value_that_is_not_a_number_breaks_a_comparison() -> None:
    assert robustness("always x < 3", x=[1.0, np.nan, 2.0]) == [-np.inf, -np.inf, 1.0]


@given(st.lists(st.floats(-10, 10), min_size=1, max_size=8), st.integers(0, 5), st.integers(0, 5))
def test_always_is_not_eventually_not(values, start, length) -> None:
    interval = f"[{start}s,{start + length}s]"
    on = {"x": values}
    assert robustness(f"always{interval} x < 3", **on) == robustness(f"not eventually{interval} not x < 3", **on)


def test_a_shift_of_the_limit_shifts_the_margin() -> None:
    on = {"x": [1.0, 2.5, 0.5]}
    assert robustness("always x < 4", **on)[0] == robustness("always x < 3", **on)[0] + 1.0
