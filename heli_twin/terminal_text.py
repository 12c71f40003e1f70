"""Text for a terminal: what comes from logs, files and arguments is cleaned; commands are quoted for pasting."""

import shlex
from collections.abc import Iterable
from difflib import get_close_matches
from pathlib import Path

SENTENCE_LIMIT = 480
"""Characters of one printed sentence."""


def clean(value: object, limit: int = SENTENCE_LIMIT) -> str:
    r"""Return a value as text of which every character is printable, on one line and at most `limit` characters long.

    Control characters (also escape sequences of terminals), line breaks, invisible format characters such as
    bidirectional overrides, and lone surrogates become their Python escapes: `\x1b`, `\n`, `\u202e`, `\ud800`.
    Longer text ends in "...".
    """
    # Python refuses to write integers of more than 4300 digits.
    text = "a huge number" if isinstance(value, int) and abs(value) >= 2**63 else str(value)
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text[: limit + 1])
    return shown if len(shown) <= limit else shown[: max(limit - 3, 0)] + "..."


def instead(wrong: object, known: Iterable[str]) -> str:
    """`'wrong': did you mean 'right'? Available: ...`, both cut to a readable length."""
    known, shown = list(known), clean(wrong, 80)
    near = get_close_matches(shown, known, n=1, cutoff=0.5)
    hint = f"did you mean '{near[0]}'? " if near else ""
    return f"'{shown}': {hint}Available: {clean(', '.join(known), 260)}"


def pasteable(*words: object) -> str:
    """Write a command as a shell reads it: each word is quoted where needed, and nothing in it is run or expanded.

    Args:
        words: The program and its arguments. A relative `Path` that begins with a dash gets `./`, so that it is read
            as a file and not as an option.
    """
    return " ".join(map(_quoted, words))


def _quoted(argument: object) -> str:
    word = str(argument)
    if isinstance(argument, Path) and word.startswith("-"):
        word = f"./{word}"
    if word.isprintable():
        return shlex.quote(word)
    # Control characters reach neither the terminal that shows the command nor the shell as such: bash reads $'\x1b'.
    return "$'" + "".join(c if c.isprintable() and c not in "\\'" else _escaped(c) for c in word) + "'"


def _escaped(character: str) -> str:
    return "".join(f"\\x{byte:02x}" for byte in character.encode("utf-8", "surrogateescape"))
