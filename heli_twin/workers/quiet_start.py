"""Loaded in the process from which workers are forked, and nowhere else: a worker that cannot start prints nothing.

When the driver is asked to end while its workers start, they find its semaphores gone. The user has asked for that; and
the driver is told of every worker that did not start.
"""

import sys


def _print_nothing(*error: object) -> None:
    pass


sys.excepthook = _print_nothing
