"""A multisine on all four inputs at once, for calibration."""

from dataclasses import dataclass
from functools import lru_cache
from math import pi
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.model import Model
from controllers.signals import NU, Array, Command


@dataclass(frozen=True, slots=True)
class Multisine:
    """A sum of sines whose frequencies lie between two limits, the next line always on the next input.

        u_i(t) = a sum over k of sin(2 pi f_k t + phase_k),   f_k = k / record,   k = i (mod 4)

    No two inputs share a frequency, so that the answers to them can be told apart although all act at once. The phases
    spread the power over the record (Schroeder's rule), which keeps the peaks low.

    Source: Schroeder, Synthesis of low-peak-factor signals, IEEE Trans. Information Theory 16 (1970); interleaved
    lines: Morelli, Multiple input design for real-time parameter estimation, SYSID 2003. Levels: found on the twin, a
    compromise between what a minute of flight tells and the room that it takes.
    """

    kind: Literal["multisine"] = "multisine"
    pitch: Annotated[float, Ge(0), Le(0.5), Unit("full stick"), doc("root mean square on the pitch input")] = 0.12
    roll: Annotated[float, Ge(0), Le(0.5), Unit("full stick"), doc("root mean square on the roll input")] = 0.12
    thrust: Annotated[float, Ge(0), Le(0.5), Unit("full stick"), doc("root mean square on the thrust input")] = 0.04
    yaw: Annotated[float, Ge(0), Le(0.5), Unit("full stick"), doc("root mean square on the yaw input")] = 0.10
    slowest: Annotated[float, Gt(0), Le(50), Unit("Hz"), doc("least frequency")] = 0.3
    fastest: Annotated[float, Gt(0), Le(50), Unit("Hz"), doc("greatest frequency")] = 8.0
    record: Annotated[float, Ge(1), Le(1000), Unit("s"), doc("time after which it repeats")] = 10.0

    def __post_init__(self) -> None:
        """Refuse limits between which an input has no line.

        Raises:
            ValueError: There are fewer lines than inputs, or more than it takes.
        """
        lines = len(_lines(self))
        if not NU <= lines <= 2000:
            raise ValueError(
                f"slowest = {self.slowest:g} Hz to fastest = {self.fastest:g} Hz holds {max(lines, 0)} lines,"
                f" {1.0 / self.record:g} Hz apart (1 / record): take limits that hold 4 to 2000"
            )

    @property
    def rms(self) -> tuple[float, float, float, float]:
        """Root mean square on each input."""
        return (self.pitch, self.roll, self.thrust, self.yaw)

    @property
    def frequencies(self) -> tuple[Array, Array, Array, Array]:
        """Angular frequencies of the lines on each input, rad/s."""
        pitch, roll, thrust, yaw = (w for w, _, _ in _waves(self))
        return pitch, roll, thrust, yaw

    def inputs(self, t: Array) -> Array:
        """Return the excitation (n, 4) at the times (n,), s."""
        return np.stack([np.sin(np.multiply.outer(t, w) + p) @ a for w, p, a in _waves(self)], axis=-1)

    def excited(self, now: int, command: Command, model: Model) -> Command:
        """Return the command with the excitation of this moment, within the limits of the inputs."""
        u = command.u + self.inputs(np.array([1e-9 * now]))[0]
        return command._replace(u=np.clip(u, model.u_min, model.u_max))


def _lines(spec: Multisine) -> range:
    """Numbers of the lines: multiples of 1 / record."""
    return range(int(np.ceil(spec.slowest * spec.record - 1e-9)), int(np.floor(spec.fastest * spec.record + 1e-9)) + 1)


@lru_cache(maxsize=8)
def _waves(spec: Multisine) -> list[tuple[Array, Array, Array]]:
    """Angular frequency, phase and amplitude of the lines of each input."""
    waves: list[tuple[Array, Array, Array]] = []
    for i, rms in enumerate(spec.rms):
        k = np.array(_lines(spec)[i::NU], np.float64)
        n = np.arange(len(k))
        amplitude = np.full(len(k), rms * np.sqrt(2.0 / len(k)))
        waves.append((2.0 * pi * k / spec.record, -pi * n * (n + 1) / len(k), amplitude))
    return waves
