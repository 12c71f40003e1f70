"""The command of a ground station that has nothing better to send."""

import numpy as np

from controllers.model import Model
from controllers.signals import Command, QpReport


def safe_hover(model: Model, now: int) -> Command:
    """Return the command that is sent without a usable estimate or plan: level, with the believed hover thrust."""
    return Command(now, np.array(model.u_hover), qp=QpReport("safe_hover", 0, 0, 0.0, 0.0))
