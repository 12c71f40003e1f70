"""A twin beside a flight that it was not fitted to: predictions, closed loop, whiteness, and the verdict."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from heli_twin.calibration import noise
from heli_twin.calibration.calibrate import flights_of
from heli_twin.calibration.coverage import covered
from heli_twin.calibration.data import Flight, flight_of
from heli_twin.calibration.structure import Structure, structure
from heli_twin.calibration.unknowns import PUSH
from heli_twin.errors import HeliTwinError
from heli_twin.experiment import Experiment
from heli_twin.experiment.envelope import Envelope
from heli_twin.experiment.tree import ExperimentError
from heli_twin.lab.plant.mujoco import MuJoCo
from heli_twin.logbook import flown_experiment
from heli_twin.recording import Log
from heli_twin.validation.agreement import Agreement, agreements
from heli_twin.validation.closed_loop import Loop, as_flown, closed_loop, tracking_rms
from heli_twin.validation.forecast import CUT, Forecast, forecast, held_fit
from heli_twin.validation.twins import Twin, twin_of
from heli_twin.workers.fleet import fleet

CERTAIN = 0.999
"""Probability with which the errors of a right twin stay below the limit."""
SLACK = 1.2
"""Factor on that limit: gusts are not quite as the model of them."""
NEAR = 0.1
"""Share by which the twin's distance from the plan may always differ."""
WINDIER = 1.3
"""Ratio of the gusts' strength to the expected one from which on it is told."""


class Side(NamedTuple):
    """One twin beside the flight."""

    name: str
    open_loop: dict[float, dict[str, Agreement]]
    """By horizon (s) and channel."""
    whiteness: Structure
    push: tuple[float, ...]
    """Constant acceleration of that day, m/s^2, world."""
    gust_strength: float
    """Of that day, m/s."""
    loop: dict[str, Loop] | str = ""
    """In closed loop, by axis; or why not."""


@dataclass(frozen=True)
class Validation:
    """The twins beside one flight; the first one is judged."""

    log: str
    sides: tuple[Side, ...]
    forecast: Forecast
    """Of the first twin."""
    envelope: Envelope
    """What the flight covers."""
    expected_gust: float
    seconds: float
    left: tuple[str, ...] = ()
    """Where the flight leaves the envelope of the calibration."""

    @property
    def judged(self) -> Side:
        """The twin that is judged."""
        return self.sides[0]

    @property
    def reasons(self) -> list[str]:
        """Sentences that say in what the twin differs from the helicopter; none if it agrees."""
        return [*_open_loop_reasons(self.judged), *_form_reasons(self.judged), *_closed_loop_reasons(self.judged)]

    @property
    def verdict(self) -> str:
        """`agrees` or `differs`."""
        return "differs" if self.reasons else "agrees"

    @property
    def remarks(self) -> list[str]:
        """What is worth telling beside the verdict."""
        told = [f"the flight leaves what the calibration covered: {phrase}" for phrase in self.left]
        ratio = self.judged.gust_strength / max(self.expected_gust, 1e-9)
        if ratio > WINDIER or ratio < 1.0 / WINDIER:
            told.append(
                f"gusts of {self.judged.gust_strength:.3f} m/s, {ratio:.2f} times what the twin expects:"
                " the errors in the plane change with them"
            )
        return told

    def as_json(self) -> dict[str, Any]:
        """The result as `heli-twin validate --json` prints it."""
        return {
            "log": self.log,
            "verdict": self.verdict,
            "reasons": self.reasons,
            "remarks": self.remarks,
            "seconds": self.seconds,
            "twins": {side.name: _plain(side) for side in self.sides},
            "envelope": self.envelope.plain(),
        }


def _plain(side: Side) -> dict[str, Any]:
    loop = side.loop
    return {
        "open_loop": {
            f"{horizon:g}": {channel: a.plain() for channel, a in each.items()}
            for horizon, each in side.open_loop.items()
        },
        "whiteness": {"memory": side.whiteness.memory, "correlation": side.whiteness.correlation},
        "gust_strength": side.gust_strength,
        "closed_loop": loop if isinstance(loop, str) else {axis: one._asdict() for axis, one in loop.items()},
    }


def limit(a: Agreement, horizon: float) -> float:
    """Return the ratio of an error to the expected one that a right twin hardly reaches."""
    # Predictions that begin every second overlap.
    free = max(a.pieces / max(horizon, 1.0), 1.0)
    return SLACK * float(np.sqrt(chi2.ppf(CERTAIN, free) / free))


def _open_loop_reasons(side: Side) -> Iterator[str]:
    worst: dict[str, tuple[float, str]] = {}
    for horizon, each in side.open_loop.items():
        for channel, a in each.items():
            most = limit(a, horizon)
            if a.ratio > most and a.ratio / most > worst.get(channel, (0.0, ""))[0]:
                text = (
                    f"{channel} errs {shown(channel, a.rms)} after {horizon:g} s, {a.ratio:.1f} times what gusts and"
                    f" cameras explain (limit {most:.1f})"
                )
                worst[channel] = a.ratio / most, text
    yield from (text for _, text in worst.values())


def _form_reasons(side: Side) -> Iterator[str]:
    channel, statistic, ratio = side.whiteness.worst
    if ratio > 1.0:
        what = "with its past" if statistic == "memory" else "with the commands"
        yield f"the residual of {channel} is not white: it correlates {what}, {ratio:.1f} times the limit"


def _closed_loop_reasons(side: Side) -> Iterator[str]:
    if isinstance(side.loop, str):
        if " failed: " in side.loop:
            yield side.loop
        return
    for axis, loop in side.loop.items():
        if abs(loop.flown - loop.twin) > NEAR * loop.twin and not loop.low <= loop.flown <= loop.high:
            yield (
                f"in closed loop {axis} was {shown(axis, loop.flown)} from the plan, and the twin is"
                f" {shown(axis, loop.twin)} (95 %: {shown(axis, max(loop.low, 0.0))} to {shown(axis, loop.high)})"
            )


def shown(channel: str, value: float) -> str:
    """Return a length in cm or an angle in degrees, for a person."""
    return f"{100 * value:.2f} cm" if channel in "xyz" else f"{np.degrees(value):.2f} deg"


def twins_of(log: Log, calibrated: Experiment, expected: Mapping[str, float], prior: Experiment) -> list[Twin]:
    """Return the twin that is judged, the uncalibrated one if it is another, and the truth if the log has it."""
    twins = [twin_of("twin", calibrated, expected)]
    others = {"uncalibrated": prior}
    if log.origin == "flight":
        try:
            flown = flown_experiment(log)
        except ExperimentError:
            flown = None
        if flown and isinstance(flown.plant, MuJoCo):
            others["true"] = flown
    for name, experiment in others.items():
        other = twin_of(name, experiment, expected)
        if not np.array_equal(other.theta, twins[0].theta):
            twins.append(other)
    return twins


class Effort(NamedTuple):
    """What a validation may cost."""

    flights: int = 4
    """Of each twin in closed loop; 0 for none."""
    processes: int | None = None
    """None for one a core, 1 for this one."""


USUAL = Effort()


def validate(
    log: Log,
    name: str,
    twins: Sequence[Twin],
    effort: Effort = USUAL,
    progress: Callable[[], None] = lambda: None,
) -> Validation:
    """Set twins beside a flight.

    Args:
        log: A flight that none of the twins was fitted to; only its poses, sent commands and plan are read.
        name: Of the log, in messages.
        twins: From `twins_of`; the first one is judged.
        effort: Flights and processes.
        progress: Called after every twin in open loop and every flight.

    Raises:
        HeliTwinError: The log has no usable flight.
    """
    pairs = [pieces_of(log, name, twin) for twin in twins]
    sides: list[Side] = []
    first: Forecast | None = None
    with fleet(effort.processes) as run:
        for side, predicted in run(_beside, list(zip(twins, *zip(*pairs, strict=True), strict=True))):
            sides.append(side)
            first = first or predicted
            progress()
    assert first is not None
    loops = partial(closed_loop, processes=effort.processes, progress=progress)
    sides = _with_loops(log, twins, sides, effort.flights, loops)
    covers = covered([pairs[0][0]])
    return Validation(
        name,
        tuple(sides),
        first,
        covers,
        float(np.exp(twins[0].eta[noise.COMPONENTS.index("gust_strength")])),
        pairs[0][0].seconds,
    )


def pieces_of(log: Log, name: str, twin: Twin) -> tuple[Flight, Flight]:
    """Return a log in windows of 2 s, and in pieces for predictions.

    Raises:
        HeliTwinError: It has no usable flight.
    """
    (whole,) = flights_of([(name, log, None)], twin.experiment)
    pieces = flight_of(log, name, twin.lab, None, CUT)
    if pieces is None:
        raise HeliTwinError(
            f"{name} is too short for a prediction: it takes 3 s in one piece with poses and sent commands, above 0.2 m"
        )
    return whole, pieces


def _beside(what: tuple[Twin, Flight, Flight]) -> tuple[Side, Forecast]:
    twin, whole, pieces = what
    try:
        with np.errstate(all="ignore"):
            held = held_fit(whole, twin)
            predicted = forecast(pieces, twin, held)
    except (np.linalg.LinAlgError, ValueError):
        raise HeliTwinError(
            f"the twin '{twin.name}' cannot predict {whole.name}: what it predicts does not stay finite; it is too far"
            " from this helicopter, or the log is damaged"
        ) from None
    push = tuple(held.state.nuisance[0, PUSH].tolist())
    gust = float(np.exp(held.state.eta[noise.COMPONENTS.index("gust_strength")]))
    return Side(twin.name, agreements(predicted), structure(held), push, gust), predicted


def _with_loops(
    log: Log, twins: Sequence[Twin], sides: list[Side], flights: int, fly: Callable[..., list[dict[str, Loop] | str]]
) -> list[Side]:
    """The sides with their flights in closed loop, where the log says how it was flown."""
    if not flights:
        return [side._replace(loop="not asked for") for side in sides]
    flown = tracking_rms(log)
    if flown is None:
        return [side._replace(loop="the log has no plan to fly: import it with its trajectory") for side in sides]
    try:
        flight = flown_experiment(log)
    except ExperimentError as error:
        return [side._replace(loop=str(error)) for side in sides]
    experiments = [
        as_flown(flight, twin.experiment, np.array(side.push) if twin.name != "true" else None)
        for twin, side in zip(twins, sides, strict=True)
    ]
    loops = fly(flown, experiments, flights)
    return [side._replace(loop=loop) for side, loop in zip(sides, loops, strict=True)]
