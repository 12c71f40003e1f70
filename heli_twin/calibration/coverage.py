"""Envelope of the flights that a twin was fitted to: speed, height, tilt, sticks, duration."""

from collections.abc import Sequence

import numpy as np

from heli_twin.calibration.data import BIN_STEPS, STEP_S, Flight
from heli_twin.experiment.envelope import Envelope

RATE_BINS = 5
"""Bins between two poses of which a speed is taken."""


def covered(flights: Sequence[Flight]) -> Envelope:
    """Return what flights covered, over the bins of all their windows."""
    y = np.concatenate([np.where(f.windows.frames[..., None] > 0, f.windows.y, np.nan) for f in flights])
    rate = np.abs(y[:, RATE_BINS:] - y[:, :-RATE_BINS]) / (RATE_BINS * BIN_STEPS * STEP_S)
    sent = np.concatenate([flight.sent.u for flight in flights])
    (a, b, c, d), (e, f, g, h) = np.quantile(sent, (0.001, 0.999), axis=0).tolist()
    return Envelope(
        speed=float(np.nanmax(np.hypot(rate[..., 0], rate[..., 1]))),
        climb=float(np.nanmax(rate[..., 2])),
        yaw_rate=float(np.nanmax(rate[..., 3])),
        tilt=float(np.nanmax(np.hypot(y[..., 4], y[..., 5]))),
        height=(float(np.nanmin(y[..., 2])), float(np.nanmax(y[..., 2]))),
        stick_low=(a, b, c, d),
        stick_high=(e, f, g, h),
        duration=max(float(flight.sent.t[-1] - flight.sent.t[0]) for flight in flights),
    )
