"""The host on which times are measured, and whether it had other things to do."""

import os
from typing import NamedTuple

BUSY_SHARE = 0.9
"""A flight that has a processor for less than this share of the time waits for other programs."""


class Host(NamedTuple):
    """A host while one flight flew alone on it."""

    processor: str
    share: float
    """Processor time of the flight over the time that passed."""
    load: float | None
    """Runnable processes before anything flew, mean of a minute; None where the system does not count them."""
    processors: int

    @property
    def busy(self) -> bool:
        """Return whether other programs had the processor too."""
        return self.share < BUSY_SHARE or (self.load or 0.0) > self.processors

    def warning(self) -> str:
        """A sentence for beside measured times; empty on a free host."""
        return " The host was busy: these times are longer than on a free one." if self.busy else ""

    def sentence(self) -> str:
        """Say how busy the host was, and how that is known."""
        load = (
            ""
            if self.load is None
            else (f"; before the flights the load average was {self.load:.1f} on {self.processors} processors")
        )
        word = "busy: other programs made these times longer" if self.busy else "free"
        return (
            f"While it flew it had a processor for {100.0 * min(self.share, 1.0):.0f} % of the time (processor time"
            f" over time passed){load}. Below {100.0 * BUSY_SHARE:g} %, or a load above the"
            f" number of processors, counts as busy: the host was {word}."
        )


def load_average() -> float | None:
    """Runnable processes, mean of the last minute."""
    try:
        return os.getloadavg()[0]
    except (OSError, AttributeError):
        return None
