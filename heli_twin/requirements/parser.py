"""Reads a formula from text.

formula  = either ["implies" formula]
either   = both ("or" both)*
both     = until ("and" until)*
until    = one ["until" [interval] one]
one      = "not" one | ("always" | "eventually") [interval] one | "(" formula ")" | compared | Boolean signal
compared = side (("<" | "<=" | ">" | ">=") side)+
side     = signal | "abs(" signal ")" | ["-"] number [unit]
interval = "[" number unit "," (number unit | "end") "]"
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple, NoReturn

from heli_twin.errors import HeliTwinError
from heli_twin.requirements.formula import Always, Below, Every, Formula, Holds, Interval, Not, Side, Until
from heli_twin.requirements.units import UNITS, converted, units_of
from heli_twin.terminal_text import clean, instead

LONGEST, DEEPEST = 2000, 40
"""Characters of a formula, and formulas inside one another."""
WORDS = ("always", "eventually", "until", "and", "or", "not", "implies", "end", "abs")
TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_][\w.]*(?:/[A-Za-z]+)?)"
    r"|(?P<sign><=|>=|[<>()\[\],%-]))"
)


class FormulaError(HeliTwinError):
    """A formula that cannot be read; the sentence names the column."""


class Token(NamedTuple):
    """A piece of the text."""

    kind: str
    """`number`, `name`, `sign` or `end`."""
    text: str
    column: int
    """From 1."""


def parse(text: str, signals: Mapping[str, str | None]) -> Formula:
    """Return the formula that a text says.

    Args:
        text: For example `always[2s,end] error.position < 10 cm`.
        signals: Unit of each known signal; None for a Boolean one.

    Raises:
        FormulaError: One sentence with the column where it cannot go on.
    """
    if len(text) > LONGEST:
        raise FormulaError(f"column {LONGEST}: the formula has {len(text)} characters, {LONGEST} are the most")
    reader = _Reader(_tokens(text), signals)
    formula = reader.formula()
    if reader.next.kind != "end":
        reader.refuse("expected `and`, `or`, `until`, `implies` or the end")
    return formula


def _tokens(text: str) -> list[Token]:
    tokens: list[Token] = []
    at = 0
    while text[at:].strip():
        match = TOKEN.match(text, at)
        if match is None:
            column = at + len(text[at:]) - len(text[at:].lstrip()) + 1
            raise FormulaError(f"column {column}: '{clean(text[column - 1])}' means nothing in a formula")
        kind = match.lastgroup or ""
        tokens.append(Token(kind, match[kind], match.start(kind) + 1))
        at = match.end()
    return [*tokens, Token("end", "", len(text.rstrip()) + 1)]


class _Reader:
    """Goes through the tokens once."""

    def __init__(self, tokens: list[Token], signals: Mapping[str, str | None]) -> None:
        self._tokens, self._at, self._signals, self._depth = tokens, 0, signals, 0

    @property
    def next(self) -> Token:
        """The token that comes next."""
        return self._tokens[self._at]

    def refuse(self, expected: str, token: Token | None = None) -> NoReturn:
        token = token or self.next
        found = f"found '{clean(token.text, 40)}'" if token.text else "found the end of the formula"
        raise FormulaError(f"column {token.column}: {expected}, {found}")

    def _take(self, *texts: str) -> str | None:
        """Take the next token if it is one of these."""
        if self.next.kind in ("name", "sign") and self.next.text in texts:
            self._at += 1
            return self._tokens[self._at - 1].text
        return None

    def _need(self, text: str) -> None:
        if not self._take(text):
            self.refuse(f"expected `{text}`")

    def formula(self) -> Formula:
        left = self._either()
        return Every(Not(left), self._deeper(self.formula), some=True) if self._take("implies") else left

    def _deeper(self, read: Callable[[], Formula]) -> Formula:
        self._depth += 1
        if self._depth > DEEPEST:
            raise FormulaError(
                f"column {self.next.column}: more than {DEEPEST} formulas inside one another; make two of it"
            )
        formula = read()
        self._depth -= 1
        return formula

    def _either(self) -> Formula:
        left = self._both()
        while self._take("or"):
            left = Every(left, self._both(), some=True)
        return left

    def _both(self) -> Formula:
        left = self._until()
        while self._take("and"):
            left = Every(left, self._until())
        return left

    def _until(self) -> Formula:
        left = self._one()
        if not self._take("until"):
            return left
        interval = self._interval()
        return Until(left, self._one(), interval)

    def _one(self) -> Formula:
        if self._take("not"):
            return Not(self._deeper(self._one))
        if word := self._take("always", "eventually"):
            interval = self._interval()
            return Always(self._deeper(self._one), interval, some=word == "eventually")
        if self._take("("):
            inner = self._deeper(self.formula)
            self._need(")")
            return inner
        token = self.next
        if self._signals.get(token.text, "") is None:
            self._at += 1
            return Holds(token.text)
        return self._compared()

    def _interval(self) -> Interval:
        if not self._take("["):
            return Interval()
        start = self._seconds()
        self._need(",")
        last = self.next
        end = None if self._take("end") else self._seconds()
        self._need("]")
        if end is not None and end < start:
            raise FormulaError(
                f"column {last.column}: the interval ends before it starts, {end:g} s before {start:g} s"
            )
        return Interval(start, end)

    def _seconds(self) -> float:
        token, side = self.next, self._side()
        if side.signal or UNITS[side.unit].quantity != "time" or side.number < 0:
            self.refuse("expected a time such as `2s` or `500 ms`", token)
        return converted(side.number, side.unit, "s")

    def _compared(self) -> Formula:
        first, left = self.next, self._side()
        sign = self._take("<", "<=", ">", ">=")
        if sign is None:
            self.refuse("expected `<`, `<=`, `>` or `>=`")
        formula: Formula | None = None
        while sign:
            right = self._side()
            low, high = (left, right) if sign.startswith("<") else (right, left)
            compared = self._below(low, high, first)
            formula = Every(formula, compared) if formula else compared
            left, sign = right, self._take("<", "<=", ">", ">=")
        assert formula is not None
        return formula

    def _below(self, low: Side, high: Side, first: Token) -> Below:
        """Both sides in the unit of the signal."""
        named = [side for side in (low, high) if side.signal]
        if not named:
            self.refuse("expected a signal on one side of the comparison", first)
        unit = self._signals[named[0].signal] or ""
        low, high = (self._in_unit(side, unit, named[0].signal, first) for side in (low, high))
        return Below(low, high, unit)

    def _in_unit(self, side: Side, unit: str, signal: str, first: Token) -> Side:
        own = (self._signals[side.signal] or "") if side.signal else side.unit
        quantity, wanted = UNITS[own].quantity, UNITS[unit].quantity
        if quantity != wanted:
            what = f"'{side.signal}' is {_a(quantity)}" if side.signal else f"{side.number:g} {own}".strip()
            if not side.signal and not own:
                what += " has no unit"
            accepted = " or ".join(units_of(wanted)) or "no unit"
            raise FormulaError(f"column {first.column}: '{signal}' is {_a(wanted)} ({accepted}), {what}")
        if side.signal and own != unit:
            raise FormulaError(f"column {first.column}: '{signal}' is in {unit}, '{side.signal}' in {own}")
        return side if side.signal else replace(side, number=converted(side.number, own, unit))

    def _side(self) -> Side:
        negative = self._take("-")
        token = self.next
        if token.kind == "number":
            self._at += 1
            number = float(token.text)
            if number == float("inf"):
                raise FormulaError(f"column {token.column}: {clean(token.text, 20)} is too large")
            return Side(number=-number if negative else number, unit=self._unit())
        if negative:
            self.refuse("expected a number after `-`")
        if self._take("abs"):
            self._need("(")
            side = replace(self._signal(), size=True)
            self._need(")")
            return side
        return self._signal()

    def _unit(self) -> str:
        if self._take("%"):
            return "%"
        token = self.next
        if token.kind != "name" or token.text in WORDS:
            return ""
        if token.text not in UNITS:
            raise FormulaError(f"column {token.column}: no unit is called {instead(token.text, filter(None, UNITS))}")
        self._at += 1
        return token.text

    def _signal(self) -> Side:
        token = self.next
        if token.kind != "name" or token.text in WORDS:
            self.refuse("expected a signal or a number")
        if token.text not in self._signals:
            raise FormulaError(f"column {token.column}: no signal is called {instead(token.text, self._signals)}")
        if self._signals[token.text] is None:
            self.refuse(f"'{token.text}' is true or false and is compared with nothing; expected a number", token)
        self._at += 1
        return Side(token.text)


def _a(quantity: str) -> str:
    return f"{'an' if quantity[0] in 'aeiou' else 'a'} {quantity}"
