"""What refuses a fitted twin, each in one sentence: its clock is seen in the delay, its form in whitened residuals."""

from collections.abc import Iterator

import numpy as np

from controllers.signals import Array
from heli_twin.calibration.data import BIN_STEPS, STEP_S
from heli_twin.calibration.fit import Fit
from heli_twin.calibration.parameters import INDEX
from heli_twin.calibration.structure import WORST_CORRELATION, WORST_MEMORY, Structure
from heli_twin.calibration.unknowns import LEVER
from heli_twin.errors import HeliTwinError
from heli_twin.reporting.figure import Curve, Figure, Panel

BIN_S = BIN_STEPS * STEP_S
TOO_LATE_S = 0.022
"""Delay beyond what was expected from which on the clocks are in doubt: twice the spread of its prior."""
FAR_M = 0.005
"""Distance of the markers from the centre of gravity that is worth telling."""


class CalibrationError(HeliTwinError):
    """The logs cannot calibrate a twin; the message says why in one sentence."""

    def __init__(self, text: str, figure: Figure | None = None) -> None:
        super().__init__(text)
        self.figure = figure
        """A picture of the reason, if there is one."""


def check_clock(fitted: Fit) -> None:
    """Refuse a delay that no radio has.

    Raises:
        CalibrationError: Commands are stamped late or early.
    """
    i = INDEX["delay"]
    delay, deviation, expected = (float(a[i]) for a in (fitted.state.theta, fitted.deviation, fitted.problem.prior))
    least = 0.5 * fitted.problem.lab.frame_period
    if delay + 2.0 * deviation < least:
        raise CalibrationError(
            f"the helicopter answers {1e3 * delay:.0f} ms after the stamps of its commands, and the wait for the radio"
            f" alone is {1e3 * least:.0f} ms: commands are stamped late, or the clocks of cameras and commands differ;"
            f" move the commands by {1e3 * (delay - expected):.0f} ms"
        )
    if delay - 2.0 * deviation > expected + TOO_LATE_S:
        raise CalibrationError(
            f"the helicopter answers {1e3 * delay:.0f} ms after the stamps of its commands,"
            f" {1e3 * expected:.0f} ms were"
            " expected: commands are stamped early, or the clocks of cameras and commands differ; if the way is"
            " as long,"
            f" say so, such as radio.latency={delay - expected + 0.005:.3f}"
        )


def remarks(fitted: Fit) -> Iterator[str]:
    """Yield what is worth telling of the nuisance, a sentence each."""
    for flight, nuisance, deviation in zip(
        fitted.problem.flights, fitted.state.nuisance, fitted.nuisance_deviation, strict=True
    ):
        lever = nuisance[LEVER]
        if np.linalg.norm(lever) > FAR_M and np.any(np.abs(lever) > 4.0 * deviation[LEVER]):
            ahead, port, above = (100.0 * lever).tolist()
            yield (
                f"{flight.name}: the markers sit {ahead:.1f} cm ahead, {port:.1f} cm to port and {above:.1f} cm"
                f" above the"
                " centre of gravity; this is corrected"
            )


def check_form(form: Structure) -> None:
    """Refuse a twin whose form does not explain the flights.

    Raises:
        CalibrationError: Names the channel and what may be missing.
    """
    channel, statistic, ratio = form.worst
    if ratio <= 1.0:
        return
    limit = WORST_MEMORY if statistic == "memory" else WORST_CORRELATION
    what = "with its past" if statistic == "memory" else "with the commands"
    hint = {
        "z": "the thrust: a battery, the ground, a load, a slow rotor",
        "yaw": "the yaw: a failing gyro, a coupling with the thrust",
        "pitch": "the attitude: a load on a string, a stabiliser bar, a loose servo",
        "roll": "the attitude: a load on a string, a stabiliser bar, a loose servo",
        "x": "the drag, or the wind",
        "y": "the drag, or the wind",
    }[channel]
    t: Array = BIN_S * np.arange(len(form.curves[channel]), dtype=np.float64)
    panel = Panel(
        f"{channel}: autocorrelation of the whitened residual",
        "lag (s)",
        "",
        [Curve(name, t, curve, style="steps", color=i) for i, (name, curve) in enumerate(form.curves.items())],
    )
    raise CalibrationError(
        f"the form of the twin is wrong in {channel}: its residual correlates {what}, {ratio * limit:.1f} times"
        f" the 95 % value"
        f" (limit {limit:g}); look at {hint}; --anyway goes on, with intervals that cannot be trusted",
        Figure("form", "What the twin leaves unexplained", "A right twin leaves nothing beyond lag 0.", [panel]),
    )
