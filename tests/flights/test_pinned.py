"""A flight stays what it was, to 10 um on any host: a change that moves it more has a new physics version."""

import json
from typing import Any

import pytest
from pinned import FLIGHTS, PINS, numbers

TOLERANCE = 1e-5
"""Rounding of another order of sums reaches 1e-6 in what the estimator believes after poses that it refused."""
PINNED = json.loads(PINS.read_text(encoding="utf-8"))


def compare(found: Any, pinned: Any, where: str) -> None:
    match pinned:
        case dict():
            assert found.keys() == pinned.keys(), where
            for key, value in pinned.items():
                compare(found[key], value, f"{where} {key}")
        case [float(), *_]:
            assert found == pytest.approx(pinned, rel=0, abs=TOLERANCE), where
        case list():
            assert len(found) == len(pinned), where
            for one, other in zip(found, pinned, strict=True):
                compare(one, other, where)
        case float():
            assert found == pytest.approx(pinned, rel=0, abs=TOLERANCE), where
        case _:
            assert found == pinned, where


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_flight_stays_what_it_was(name: str) -> None:
    assert name in PINNED, "a new member of a family: run python tests/pinned.py"
    compare(numbers(name), PINNED[name], name)
