"""Bounds of a study's tables before anything is made of them: what TOML allows and no study means."""

import math
from typing import Any

from heli_twin.studies.errors import StudyError
from heli_twin.terminal_text import clean

MAX_DEPTH = 30
"""Tables and lists inside each other."""
MAX_NAME_LENGTH = 100
MAX_INTEGER_BITS = 63


def check_plain(tree: Any) -> None:
    """Refuse tables that hold other things than text, numbers, lists and tables of reasonable size.

    Raises:
        StudyError: Names the first such value and the limit.
    """
    waiting: list[tuple[str, Any, int]] = [("", tree, 0)]
    while waiting:
        path, value, depth = waiting.pop()
        where = path.lstrip(".")
        if depth > MAX_DEPTH:
            raise StudyError(f"{clean(where, 60)} is nested too deeply: at most {MAX_DEPTH} tables inside each other")
        if isinstance(value, dict):
            for key, inner in value.items():
                _check_name(where, key)
                waiting.append((f"{path}.{key}", inner, depth + 1))
        elif isinstance(value, list | tuple):
            waiting.extend((f"{path}[{i}]", inner, depth + 1) for i, inner in enumerate(value))
        else:
            _check_value(clean(where, 60), value)


def _check_name(where: str, key: Any) -> None:
    if not isinstance(key, str) or len(key) > MAX_NAME_LENGTH or not key.isprintable():
        there = f" in {clean(where, 60)}" if where else ""
        raise StudyError(
            f"the name {clean(key, 60)}{there} is no name: write 1 to {MAX_NAME_LENGTH} characters, none of them a"
            " control character"
        )


def _check_value(where: str, value: Any) -> None:
    if isinstance(value, bool) or value is None:
        return
    if isinstance(value, int):
        if value.bit_length() > MAX_INTEGER_BITS:
            raise StudyError(f"{where} is a whole number of {value.bit_length()} bits: at most {MAX_INTEGER_BITS}")
    elif isinstance(value, float):
        if not math.isfinite(value):
            raise StudyError(f"{where} = {value} is not a finite number")
    elif not isinstance(value, str):
        raise StudyError(f"{where} = {clean(value, 60)}: write a number, text, a list or a table")
    elif any(not c.isprintable() and c not in "\n\t" for c in value):
        raise StudyError(f"{where} = {clean(value, 60)} holds a control character: take it out")
