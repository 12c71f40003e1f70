"""From logs to a calibrated helicopter: the fit in stages, its parameters with intervals, what is left out.

Effects that the flights do not show are left out, since each costs the others accuracy: hub drag, thrust-yaw coupling,
the battery, and the servos' play and speed, which are fitted only if the attitude is explained better with them. One
that is believed, and that the flights neither show nor contradict, stays with what is believed as its prior: without it
others would take its place. That is the ground effect at the height of a room.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controllers.signals import Array
from heli_twin.calibration import noise
from heli_twin.calibration.checks import CalibrationError, check_clock, check_form, remarks
from heli_twin.calibration.data import Flight, flight_of
from heli_twin.calibration.fit import CONVERGED, Fit, fit
from heli_twin.calibration.frames import FRAME_GAIN, framed, timed
from heli_twin.calibration.parameters import INDEX, NAMES, PARAMETERS, POSITIVE, SPREAD, lab_of, of_experiment, vector
from heli_twin.calibration.problem import Problem
from heli_twin.calibration.recording_faults import check_recording
from heli_twin.calibration.structure import Structure, structure
from heli_twin.calibration.unknowns import FIXED
from heli_twin.experiment import Experiment
from heli_twin.recording import Log

EFFECTS = {
    "hub_drag": ("hub_drag_per_iyy",),
    "thrust_yaw_coupling": ("thrust_yaw_coupling_per_izz",),
    "battery": ("battery_drain", "battery_droop"),
    "servo": ("servo_backlash", "servo_slowness"),
    "ground_effect": ("ground_effect",),
}
"""Parameters of each plant effect."""
SHOWN = 16.0
"""Least squared distance from zero, in standard deviations, of an effect that the flights show."""
CONTRADICTED = 9.0
"""Least squared distance from what is believed, in standard deviations, of an effect that the flights contradict."""
Z_95 = 1.959964
TOLD = 0.5
"""A parameter is told if its standard deviation is below this share of the prior's."""


class Known(NamedTuple):
    """Value and interval of one parameter."""

    value: float
    low: float
    """Lower end of the 95 % interval."""
    high: float
    told: bool
    """False where the prior speaks."""
    unit: str


@dataclass(frozen=True)
class Calibrated:
    """A helicopter, as its flights tell it."""

    base: Experiment
    """The helicopter that was believed before: form and prior."""
    fit: Fit
    first: Fit
    """The fit with all effects."""
    kept: tuple[str, ...]
    """Effects that it has: those that the flights show, or do not contradict."""
    structure: Structure
    mass: float
    """kg, as weighed or believed."""
    logs: tuple[str, ...]

    @property
    def seconds(self) -> float:
        """Length of all windows."""
        return sum(flight.seconds for flight in self.fit.problem.flights)

    @property
    def parameters(self) -> dict[str, Known]:
        """Values and intervals of all parameters, by name."""
        known = {}
        for i, p in enumerate(PARAMETERS):
            # An effect that was left out: what the fit with all of them said.
            source = self.fit if self.fit.problem.spread[i] > FIXED else self.first
            if source.problem.spread[i] <= FIXED:
                continue
            mean, deviation = float(source.state.theta[i]), float(source.deviation[i])
            ends = np.array([mean, mean - Z_95 * deviation, mean + Z_95 * deviation])
            value, low, high = (np.exp(ends) if POSITIVE[i] else ends).tolist()
            known[p.name] = Known(value, low, high, bool(deviation < TOLD * SPREAD[i]), p.unit)
        for name, unit in (("gust_strength", "m/s"), ("gust_time", "s")):
            i = noise.COMPONENTS.index(name)
            mean, deviation = float(self.fit.state.eta[i]), float(np.sqrt(self.fit.eta_covariance[i, i]))
            value, low, high = np.exp([mean, mean - Z_95 * deviation, mean + Z_95 * deviation]).tolist()
            known[name] = Known(value, low, high, bool(deviation < TOLD * noise.PRIOR_SPREAD[i]), unit)
        return known

    @property
    def remarks(self) -> list[str]:
        """Return what is worth telling beside the parameters, a sentence each."""
        return list(remarks(self.fit))

    def as_json(self) -> dict[str, Any]:
        """The result as `heli-twin calibrate --json` prints it."""
        eta = np.exp(self.fit.state.eta)
        return {
            "parameters": {
                name: {"value": k.value, "interval": [k.low, k.high], "told": k.told, "unit": k.unit}
                for name, k in self.parameters.items()
            },
            "effects": {name: name in self.kept for name in EFFECTS},
            "noise": dict(zip(noise.COMPONENTS, eta.tolist(), strict=True)),
            "structure": {
                "memory": self.structure.memory,
                "correlation": self.structure.correlation,
                "variance": self.structure.variance,
            },
            "remarks": self.remarks,
            "mass": self.mass,
            "last_step": self.fit.last_step,
            "iterations": self.fit.iterations,
            "seconds": self.seconds,
            "logs": list(self.logs),
        }


def flights_of(logs: Sequence[tuple[str, Log, int | None]], base: Experiment) -> list[Flight]:
    """Return logs as flights that can be fitted.

    Args:
        logs: Name, log, and the seed of a flight of the twin.
        base: Says what is known of the radio.

    Raises:
        CalibrationError: A log has no usable window, lacks an input, or two have the same gusts.
    """
    lab = lab_of(base)
    flights: list[Flight] = []
    for name, log, seed in logs:
        if len(log.sent.time) and not np.isfinite(log.sent.u).all():
            raise CalibrationError(
                f"{name} lacks a sent command: a calibration needs all four inputs; import the recording with them"
                " (`heli-twin import --help`)"
            )
        flight = flight_of(log, name, lab, seed)
        if flight is None:
            raise CalibrationError(
                f"{name} has no usable flight: it takes windows of 2 s with poses and sent commands, above 0.2 m;"
                " `heli-twin calibrate` without a log flies what is needed"
            )
        flights.append(flight)
    seeds: dict[int, str] = {}
    for flight in flights:
        if flight.seed is not None and flight.seed in seeds:
            raise CalibrationError(
                f"{seeds[flight.seed]} and {flight.name} were flown with the same seed, {flight.seed}: their gusts are"
                f" the same and would count twice; fly one with another, such as seed={flight.seed + 1}"
            )
        if flight.seed is not None:
            seeds[flight.seed] = flight.name
    return flights


def calibrate(
    flights: Sequence[Flight],
    base: Experiment,
    *,
    mass: float | None = None,
    anyway: bool = False,
    progress: Callable[[], None] = lambda: None,
) -> Calibrated:
    """Fit the twin to flights.

    Args:
        flights: From `flights_of`.
        base: The helicopter that is believed, whose parameters are the prior's mean.
        mass: As weighed, kg; None for that of `base`.
        anyway: Return a twin that has not converged, or whose form does not explain the flights, too.
        progress: Called after every iteration.

    Raises:
        CalibrationError: The logs cannot calibrate a twin.
    """
    expected = of_experiment(base)
    believed = vector(np.array([expected[name] for name in NAMES]))
    prior = believed.copy()
    for names in EFFECTS.values():
        prior[[INDEX[name] for name in names]] = 0.0
    check_recording(flights, prior)
    first = _with_all_effects(flights, base, prior, progress)
    kept, final = _with_those_shown(first, believed, progress)
    check_clock(final)
    if final.last_step > CONVERGED and not anyway:
        raise CalibrationError(
            f"the fit has not converged: its last step was {final.last_step:.2f} standard deviations, after"
            f" {final.iterations} iterations (limit {CONVERGED:g}); believe in a helicopter that is nearer to this one,"
            " or give longer flights; --anyway goes on"
        )
    form = structure(final)
    if not anyway:
        check_form(form)
    weighed = mass if mass is not None else getattr(base.plant, "mass", 0.028)
    return Calibrated(base, final, first, kept, form, weighed, tuple(f.name for f in flights))


def _with_all_effects(flights: Sequence[Flight], base: Experiment, prior: Array, progress: Callable[[], None]) -> Fit:
    """Fit the helicopter with all effects, the servos' only if they explain the poses better."""
    spread = SPREAD.copy()
    hold(spread, "servo")
    problem = Problem(flights, lab_of(base), prior, spread)
    blind = fit(problem, None, progress, enough=1.0, limit=5)
    begin = framed(problem, blind, np.log(noise.PRIOR))
    loose = Problem(flights, lab_of(base), prior, SPREAD.copy())
    played, gain = timed(loose, blind, begin._replace(theta=loose.started(begin.theta, SPREAD)))
    if gain < FRAME_GAIN:
        return fit(problem, begin, progress, enough=0.5, limit=4)
    first = fit(loose, played, progress, enough=1.0, limit=5)
    return fit(loose, timed(loose, first, first.ahead)[0], progress, enough=0.5, limit=5)


def _with_those_shown(first: Fit, believed: Array, progress: Callable[[], None]) -> tuple[tuple[str, ...], Fit]:
    """Return the effects that stay, and the fit with them alone."""
    old = first.problem
    shown = [name for name in EFFECTS if _distance(first, name, 0.0 * believed) > SHOWN]
    kept = tuple(name for name in EFFECTS if name in shown or _is_open(first, name, believed))
    prior, spread, theta = old.prior.copy(), old.spread.copy(), first.ahead.theta.copy()
    for name, parameters in EFFECTS.items():
        places = [INDEX[p] for p in parameters]
        if name not in kept:
            hold(spread, name)
            theta[places] = 0.0
        elif name not in shown:
            prior[places] = believed[places]
    return kept, fit(Problem(old.flights, old.lab, prior, spread), first.ahead._replace(theta=theta), progress)


def hold(spread: Array, effect: str) -> None:
    """Hold the parameters of an effect where the prior has them, in place."""
    spread[[INDEX[name] for name in EFFECTS[effect]]] = 0.1 * FIXED


def _is_open(fitted: Fit, effect: str, believed: Array) -> bool:
    """Whether an effect is believed, fitted, and not contradicted."""
    i = [INDEX[name] for name in EFFECTS[effect]]
    is_fitted = bool(np.any(believed[i])) and fitted.problem.spread[i[0]] > FIXED
    return is_fitted and _distance(fitted, effect, believed) < CONTRADICTED


def _distance(fitted: Fit, effect: str, point: Array) -> float:
    """Squared distance of an effect's parameters from those of a vector (n,), in standard deviations; 0 if held."""
    i = [INDEX[name] for name in EFFECTS[effect]]
    if fitted.problem.spread[i[0]] <= FIXED:
        return 0.0
    wide = np.maximum(np.diag(fitted.covariance), np.diag(fitted.sandwich))[i]
    scale = np.sqrt(wide / np.diag(fitted.covariance)[i])
    covariance = fitted.covariance[np.ix_(i, i)] * np.outer(scale, scale)
    away = (fitted.state.theta - point)[i]
    return float(away @ np.linalg.solve(covariance, away))
