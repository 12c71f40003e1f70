"""A run that is sent to a worker process, and the result that comes back."""

from typing import Any, NamedTuple


class Task(NamedTuple):
    """One run to fly."""

    id: str
    experiment: str
    """Canonical JSON."""
    score: str
    """The column of the row by which runs are ranked; a greater value is worse."""
    keep_log: bool
    """Keep the log in any case."""
    keep_failed: bool
    """Keep the log if the flight does not complete."""
    keep_above: float | None
    """Keep the log if the flight completes with a greater score than this; None: do not look at the score."""
    own: tuple[Any, ...] = ()
    """The members of the user's own that the driver has named (`families.OwnSource`)."""
    programs: tuple[Any, ...] = ()
    """The programs of external laws that the driver has named (`controllers.programs.Program`)."""
    requirements: dict[str, Any] | None = None
    """What the flight must do, formulas by name."""


class Flown(NamedTuple):
    """The result of a run."""

    row: dict[str, Any]
    """Its columns, such as `id`, `outcome` and the metrics."""
    log: bytes | None = None
    """Its MCAP file, if it is to be kept."""
