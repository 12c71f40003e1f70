"""A run for a worker, and what comes back."""

from typing import Any, NamedTuple


class Task(NamedTuple):
    """One run to fly."""

    id: str
    experiment: str
    """Canonical JSON."""
    score: str
    keep_log: bool
    """Whatever comes of it."""
    keep_failed: bool
    keep_above: float | None
    """If it completes with a greater score; None: not for its score."""


class Flown(NamedTuple):
    """What came of it."""

    row: dict[str, Any]
    log: bytes | None = None
    """Its MCAP, if it is to be kept."""
