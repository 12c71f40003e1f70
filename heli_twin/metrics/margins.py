"""Stability margins of the loop that flew, from its answer to a multisine that the ground station does not know of.

The loop is opened between the ground station and the helicopter: the helicopter gets the sent command c and a probe d.
For each input, the Fourier coefficients at the probed frequencies give the sensitivity S = (c + d) / d and the loop
L = 1 / S - 1, the product of helicopter, cameras, estimator and law. No other input is probed at these frequencies, so
that the coupling between axes does not disturb.

Source: Ljung, System Identification, 2nd ed., ch. 6 (periodic inputs); Astrom and Murray, Feedback Systems, ch. 10.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.excitations.multisine import Multisine
from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.recording import Log

AXES = ("x", "y", "z", "yaw")
"""The loops, by what their inputs move: pitch, roll, thrust, yaw."""


class LoopResponse(NamedTuple):
    """Frequency response of one loop, opened at its input."""

    frequency: Array
    """(n,) rad/s, increasing."""
    loop: NDArray[np.complex128]
    """(n,) loop transfer L; negative feedback, so that it must not go round -1."""


class Margins(NamedTuple):
    """Stability margins of a loop; infinite where it stays stable at all measured frequencies."""

    gain: float
    """Factor on the loop gain at which it becomes unstable, above 1."""
    delay: float
    """More delay at which it becomes unstable, s."""
    peak_sensitivity: float
    """Ms, the largest |S|: 1 / Ms is the least distance of L to -1."""
    crossover: float
    """Highest frequency at which |L| = 1, rad/s; 0 if there is none."""

    def plain(self) -> dict[str, float | None]:
        """Return the margins for JSON; None for one that is infinite."""
        return {name: value if np.isfinite(value) else None for name, value in self._asdict().items()}


def loop_responses(log: Log, probe: Multisine, settled: float = 5.0) -> dict[str, LoopResponse]:
    """Return the response of each loop over the last whole records of a flight.

    Args:
        log: A flight with the probe, in which nothing saturates.
        probe: The multisine that was added to its commands on their way.
        settled: The first seconds, which are left out, s.

    Raises:
        HeliTwinError: The flight is shorter than one record after it has settled.
    """
    t = 1e-9 * np.asarray(log.sent.time, dtype=np.float64)
    records = int((t[-1] - settled) / probe.record) if len(t) else 0
    if records < 1:
        raise HeliTwinError(
            f"the flight lasts {t[-1] if len(t) else 0.0:.1f} s: margins need {settled + probe.record:g} s,"
            f" {settled:g} s to settle and one record of the multisine"
        )
    kept = t > t[-1] - records * probe.record + 1e-6
    t, u = t[kept], log.sent.u[kept]
    d = probe.inputs(t)
    responses: dict[str, LoopResponse] = {}
    for i, (axis, w) in enumerate(zip(AXES, probe.frequencies, strict=True)):
        turn = np.exp(-1j * np.multiply.outer(w, t))
        sensitivity = (turn @ (u[:, i] + d[:, i])) / (turn @ d[:, i])
        responses[axis] = LoopResponse(w, np.asarray(1.0 / sensitivity - 1.0, np.complex128))
    return responses


def margins(response: LoopResponse) -> Margins:
    """Return the margins of a loop, interpolated between the measured frequencies."""
    frequency, loop = _dense(response)
    size, phase = np.abs(loop), np.unwrap(np.angle(loop))
    crossings, share = _zeros(size - 1.0)
    at = _between(frequency, crossings, share)
    # Lag from -180 degrees on, the nearest one that comes with more delay.
    lags = np.mod(_between(phase, crossings, share) + np.pi, 2.0 * np.pi)
    delay = float((lags / at).min()) if len(at) else np.inf
    gains = -1.0 / _between(loop.real, *_zeros(loop.imag))
    # A crossing where the real part is positive gives a negative gain.
    above = gains[gains > 1.0]
    return Margins(
        float(above.min()) if len(above) else np.inf,
        delay,
        float((1.0 / np.abs(1.0 + loop)).max()),
        float(at[-1]) if len(at) else 0.0,
    )


def _zeros(values: Array) -> tuple[NDArray[np.intp], Array]:
    """Samples after which the values change sign, and how far the zero is from each, in samples."""
    before = np.flatnonzero(np.diff(np.sign(values)) != 0)
    return before, values[before] / (values[before] - values[before + 1])


def _between(values: Array, before: NDArray[np.intp], share: Array) -> Array:
    return values[before] + share * (values[before + 1] - values[before])


def _dense(response: LoopResponse) -> tuple[Array, NDArray[np.complex128]]:
    """A loop at 4000 frequencies: log magnitude and phase are straight lines between the measured ones."""
    at = np.log(response.frequency)
    dense = np.linspace(at[0], at[-1], 4000)
    size = np.interp(dense, at, np.log(np.abs(response.loop)))
    phase = np.interp(dense, at, np.unwrap(np.angle(response.loop)))
    return np.exp(dense), np.exp(size + 1j * phase)
