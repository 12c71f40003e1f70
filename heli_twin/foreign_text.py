"""Text from logs, files and arguments, made safe and short enough for a terminal."""

SENTENCE_LIMIT = 480
"""Characters of one printed sentence."""


def clean(text: str, limit: int = SENTENCE_LIMIT) -> str:
    r"""Return text of which every character is printable, on one line and at most `limit` characters long.

    Control characters (also escape sequences of terminals), line breaks, invisible format characters such as
    bidirectional overrides, and lone surrogates become their Python escapes: `\x1b`, `\n`, `\u202e`, `\ud800`.
    Longer text ends in "...".
    """
    shown = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text[: limit + 1])
    return shown if len(shown) <= limit else shown[: max(limit - 3, 0)] + "..."
