"""The one function that writes a command line for a person to paste into a shell."""

import shlex
from pathlib import Path


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
