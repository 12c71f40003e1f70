"""A control law in another process and language, asked for each command through its standard input and output.

The wire is lines of decimal numbers in ASCII, separated by blanks; numbers are written so that reading them as a double
gives the same double. The two sides take turns, so that the speed of the process never changes a flight.

1. We send `heli_twin VERSION PERIOD STEPS NX NU EXTRA`, then the believed `u_min`, `u_max` and hover input, NU = 4
   numbers each. The period is in s; STEPS is how many periods of the reference it is sent ahead; NX = 8 is the number
   of states, and EXTRA that of further states, 0 of our estimators. It answers `heli_twin VERSION`.
2. In each control step we send one line of 28 + (STEPS + 1) NX + STEPS NU + 2 EXTRA numbers:

   | place | what |
   |---|---|
   | 0 | control time, ns |
   | 1 | time of the estimated state, when the command will act, ns |
   | 2 to 9 | estimated state x y z yaw (world, m and rad), vx vy vz (body, m/s), yaw rate (rad/s) |
   | 10 to 13 | estimated disturbance x y z (world, m/s^2), yaw (rad/s^2) |
   | 14 to 25 | variances of position, velocity and disturbance of x, of y, of z, of yaw |
   | 26, 27 | capture time of the newest pose, ns; number of poses refused so far |
   | 28 on | reference: STEPS + 1 states as above, from the time of the estimate on, then STEPS inputs |
   | last | the further states of the estimate, then the variance of each |

   It answers with one line of 5 numbers: the control time that it was sent, and its inputs pitch, roll, thrust and yaw,
   fractions of full stick from -1 to 1.
3. At the end of the flight it reads the end of file, and ends.

A process that dies, does not answer within the limit, or answers anything else makes the run *invalid*: it has no
digest and is not a failure of the controller. The limit is outside of the experiment, in the environment variable
`HELI_TWIN_EXTERNAL_LIMIT`, s. The standard error is free; its last line is told with the reason of a failure.
"""

import math
import os
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, MaxLen, Unit, doc

from controllers.errors import LawFailed
from controllers.fallback import safe_hover
from controllers.line_process import LineProcess, ProcessFailed
from controllers.model import Model
from controllers.programs import Program, named, program_at, unpacked
from controllers.signals import NU, NX, Array, Command, Estimate, Reference

WIRE_VERSION = 1
LIMIT_VARIABLE = "HELI_TWIN_EXTERNAL_LIMIT"
LIMIT_S = 10.0
"""Longest time for an answer, also on a busy machine and while the process starts, unless the variable says another."""
SHOWN = 60
"""Characters of an answer that a message repeats."""


@dataclass(frozen=True, slots=True)
class External:
    """A law in a process of its own: a program of yours in any language that reads and writes lines of numbers.

    `controllers/laws/external.py` and the README describe the lines. What the process does with them decides alone how
    it flies; its gains are its own.
    """

    kind: Literal["external"] = "external"
    period: Annotated[float, Ge(0.001), Le(0.2), Unit("s"), doc("control period")] = 0.02
    command: Annotated[
        tuple[str, ...], MaxLen(100), doc('the program and its arguments, ["./pid"]; kept as names and hashes of files')
    ] = ()
    steps: Annotated[int, Ge(1), Le(60), doc("periods of the reference that it is sent ahead")] = 1
    model: Annotated[Model, doc("the helicopter as the ground station believes it")] = field(default_factory=Model)

    def __post_init__(self) -> None:
        """Replace a command by its marks.

        Raises:
            ValueError: It names no program that can be run here.
        """
        object.__setattr__(self, "command", named(self.command))

    def check(self) -> None:
        """Check that a flight can start here.

        Raises:
            ValueError: The command was not named in this process, or has changed since, or the limit is no time.
        """
        program_at(self.command)
        limit_from_environment()

    def start(self) -> "ExternalController":
        """Return a controller for one flight; its process starts with the first step.

        Raises:
            ValueError: As for `check`.
        """
        return ExternalController(self, program_at(self.command), limit_from_environment())


class ExternalController:
    """The process of one flight."""

    def __init__(self, spec: External, program: Program, limit: float) -> None:
        self._spec, self._program, self._limit = spec, program, limit
        # The law, not its interpreter.
        self._name = program.marks[program.files[0].place if program.files else 0].rpartition("@")[0]
        self._process: LineProcess | None = None
        self._held = ExitStack()

    def step(self, now: int, estimate: Estimate, reference: Reference) -> Command:
        """Ask the process for the inputs; without a finite estimate it is not asked, and a hover is commanded.

        Raises:
            LawFailed: There is no answer, or a wrong one; the message tells which.
        """
        if not np.isfinite(estimate.x).all():
            return safe_hover(self._spec.model, now)
        try:
            process = self._process or self._begin(len(estimate.extra))
            return Command(now, _inputs(process.ask(_step_line(now, estimate, reference)), now))
        except ProcessFailed as error:
            raise LawFailed(now, self._reason(now, str(error))) from None

    def explain(self, command: Command) -> Command:
        """Return the command unchanged: what the process plans stays there."""
        return command

    def close(self) -> None:
        """End the process, in whatever state it is."""
        self._held.close()

    def _begin(self, extra: int) -> LineProcess:
        process = self._process = LineProcess(unpacked(self._program, self._held), self._limit)
        self._held.callback(process.close)
        answer = process.ask(_hello_line(self._spec, extra))
        if answer.split() != ["heli_twin", str(WIRE_VERSION)]:
            raise ProcessFailed(
                f"it has to answer the first line with 'heli_twin {WIRE_VERSION}', not {_shown(answer)}"
            )
        return process

    def _reason(self, now: int, why: str) -> str:
        said = self._process.last_words() if self._process else ""
        for path, mark in zip(self._program.words, self._program.marks, strict=True):
            # No path of this machine gets into a log.
            said = said.replace(path, mark.rpartition("@")[0] or mark)
        told = f"; its last words were {said[:150]!r}" if said else ""
        return f"{self._name} failed as a control law at {1e-9 * now:.2f} s: {why}{told}"


def limit_from_environment() -> float:
    """The longest time for an answer, s.

    Raises:
        ValueError: The environment variable is no time.
    """
    text = os.environ.get(LIMIT_VARIABLE, str(LIMIT_S))
    try:
        limit = float(text)
    except ValueError:
        limit = math.nan
    if not 0.0 < limit <= 3600.0:
        raise ValueError(
            f"command: the environment variable {LIMIT_VARIABLE} is {text[:40]!r}: it has to be a number of seconds"
            f" above 0 and at most 3600; without it the limit is {LIMIT_S:g} s"
        )
    return limit


def _hello_line(spec: External, extra: int) -> str:
    sizes = f"{spec.steps} {NX} {NU} {extra}"
    limits = " ".join(map(repr, (*spec.model.u_min, *spec.model.u_max, *spec.model.u_hover)))
    return f"heli_twin {WIRE_VERSION} {spec.period!r} {sizes} {limits}\n"


def _step_line(now: int, estimate: Estimate, reference: Reference) -> str:
    newest = (estimate.pose_stamp, estimate.rejected)
    believed = [*estimate.x.tolist(), *estimate.disturbance.tolist(), *estimate.variance.ravel().tolist()]
    ahead = [*reference.x.ravel().tolist(), *reference.u.ravel().tolist()]
    further = [*estimate.extra.tolist(), *estimate.extra_variance.tolist()]
    return " ".join(map(repr, (now, estimate.stamp, *believed, *newest, *ahead, *further))) + "\n"


def _inputs(answer: str, now: int) -> Array:
    """The inputs (4,) in an answer.

    Raises:
        ProcessFailed: It is no answer to this step.
    """
    words = answer.split()
    if len(words) != 1 + NU:
        raise ProcessFailed(f"it has to answer with {1 + NU} numbers, not {len(words)}: {_shown(answer)}")
    try:
        # Python alone reads 1_000.
        time, *inputs = (float(word.replace("_", "?")) for word in words)
    except ValueError:
        raise ProcessFailed(f"it answered what is no row of numbers: {_shown(answer)}") from None
    if time != now:
        raise ProcessFailed(f"its answer has to begin with the control time that it was sent, {now}: {_shown(answer)}")
    for name, u in zip(("pitch", "roll", "thrust", "yaw"), inputs, strict=True):
        # Not `abs(u) > 1`: NaN must be refused too.
        if not -1.0 <= u <= 1.0:
            raise ProcessFailed(f"its {name} input is {u:g}, and full stick is -1 to 1: clip it there")
    return np.array(inputs)


def _shown(answer: str) -> str:
    return repr(answer if len(answer) <= SHOWN else f"{answer[:SHOWN]}...")
