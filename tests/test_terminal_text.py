import pytest
from hypothesis import given
from hypothesis import strategies as st

from heli_twin.terminal_text import clean


@pytest.mark.parametrize(
    ("text", "cleaned"),
    [
        ("wind 3 m/s, größer", "wind 3 m/s, größer"),
        ("\x1b[31mred\x1b[0m", r"\x1b[31mred\x1b[0m"),
        ("title \x1b]0;owned\x07", r"title \x1b]0;owned\x07"),
        ("one\r\ntwo\tthree\x00", r"one\r\ntwo\tthree\x00"),
        ("C1 \x9b2J, delete \x7f", r"C1 \x9b2J, delete \x7f"),
        ("\u202eright to left\u2066\u200f", r"\u202eright to left\u2066\u200f"),
        ("\ud800 and \u2028", r"\ud800 and \u2028"),
    ],
)
def test_control_characters_become_visible(text: str, cleaned: str) -> None:
    assert clean(text) == cleaned


def test_text_is_cut_at_the_limit() -> None:
    assert clean("x" * 10, 10) == "x" * 10
    assert clean("x" * 11, 10) == "x" * 7 + "..."
    assert clean("\x1b" * 3, 10) == r"\x1b\x1" + "..."
    assert len(clean("x" * 10_000_000)) == 480


@given(st.text(st.characters()), st.integers(3, 40))
def test_what_is_cleaned_is_printable_and_stays_as_it_is(text: str, limit: int) -> None:
    cleaned = clean(text, limit)
    assert cleaned.isprintable()
    assert len(cleaned) <= limit
    assert clean(cleaned, limit) == cleaned
    cleaned.encode()
