"""A flight that is going to be killed: it tells its simulated time on standard output at every control step."""

import os
import sys

from heli_twin import load
from heli_twin.mission import fly


def tell(t: float) -> None:
    """Unbuffered, so that what was told has happened."""
    os.write(1, b"%d\n" % round(1e9 * t))


if __name__ == "__main__":
    fly(load("ideal", ["duration=60", "trajectory=hover"]), log_dir=sys.argv[1], progress=tell)
