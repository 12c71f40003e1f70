"""Formulas are read, or refused in one sentence with the place."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from heli_twin.requirements.formula import Always, Below, Every, Holds, Interval, Not, Side, Until
from heli_twin.requirements.parser import DEEPEST, LONGEST, FormulaError, parse
from heli_twin.requirements.signals import UNITS_OF

HEIGHT = Side("height")


def below(limit: float, unit: str = "m") -> Below:
    return Below(HEIGHT, Side(number=limit, unit=unit), "m")


def test_precedence_is_not_until_and_or_implies() -> None:
    text = "not landed until height < 1 m and landed or touching implies height < 2 m"
    landed, until = Holds("landed"), Until(Not(Holds("landed")), below(1.0))
    either = Every(Every(until, landed), Holds("touching"), some=True)
    assert parse(text, UNITS_OF) == Every(Not(either), below(2.0), some=True)


def test_limits_are_kept_in_the_unit_of_the_signal() -> None:
    formula = parse("always[500 ms,2s] height < 12.5 cm", UNITS_OF)
    assert formula == Always(below(0.125, "cm"), Interval(0.5, 2.0))
    assert formula.inner.shown_unit == "cm"
    assert parse("tilt < 180 deg", UNITS_OF).high.number == pytest.approx(3.141592653589793)
    assert parse("solve_ms < 0.005 s", UNITS_OF).high.number == 5.0


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "column 1: expected a signal or a number, found the end of the formula"),
        ("height < ", "column 9: expected a signal or a number, found the end of the formula"),
        ("heigth < 1 m", "column 1: no signal is called 'heigth': did you mean 'height'?"),
        ("height < 1", "column 1: 'height' is a length (m or cm or mm), 1 has no unit"),
        ("height < 1 deg", "column 1: 'height' is a length (m or cm or mm), 1 deg"),
        ("height < 1 ft", "column 12: no unit is called 'ft': Available: m, cm"),
        ("height < tilt", "column 1: 'height' is a length (m or cm or mm), 'tilt' is an angle"),
        ("1 m < 2 m", "column 1: expected a signal on one side of the comparison, found '1'"),
        ("landed < 1 m", "column 8: expected `and`, `or`, `until`, `implies` or the end, found '<'"),
        ("height", "column 7: expected `<`, `<=`, `>` or `>=`, found the end of the formula"),
        ("height < landed", "column 10: 'landed' is true or false and is compared with nothing"),
        ("always[2s,1s] landed", "column 11: the interval ends before it starts, 1 s before 2 s"),
        ("always[2,end] landed", "column 8: expected a time such as `2s` or `500 ms`, found '2'"),
        ("always[2 s landed", "column 12: expected `,`, found 'landed'"),
        ("(landed", "column 8: expected `)`, found the end of the formula"),
        ("landed landed", "column 8: expected `and`, `or`, `until`, `implies` or the end, found 'landed'"),
        ("landed & touching", "column 8: '&' means nothing in a formula"),
        ("height < -landed", "column 11: expected a number after `-`, found 'landed'"),
        ("height < 1e999 m", "column 10: 1e999 is too large"),
        ("(" * 60 + "landed" + ")" * 60, f"more than {DEEPEST} formulas inside one another"),
        ("not " * 60 + "landed", f"more than {DEEPEST} formulas inside one another"),
        ("landed or " * 300 + "landed", f"has 3006 characters, {LONGEST} are the most"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_place(text, sentence) -> None:
    with pytest.raises(FormulaError) as refused:
        parse(text, UNITS_OF)
    assert sentence in str(refused.value)
    assert len(str(refused.value)) < 480


WORDS = "<= always until and not implies abs end height tilt landed 1 2s 1e5 ( ) [ ] , < > - % é ."
words = st.sampled_from([*WORDS.split(), "1 m", "\x1b[0m"])


@given(st.lists(words, max_size=12).map(" ".join) | st.text(max_size=40))
@example("always[")
@example("\x00")
def test_any_text_is_a_formula_or_one_sentence(text) -> None:
    told = "column "
    try:
        parse(text, UNITS_OF)
    except FormulaError as error:
        told = str(error)
    assert told.startswith("column ")
    assert told.isprintable()
    assert len(told) < 480
