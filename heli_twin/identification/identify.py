"""Gains and damping of the helicopter from flight logs, as a value, as JSON and as TOML.

The paper's step responses and least squares, extended to work with gusts and noise, see `fit`.

Source: Kunz, Huck, Summers, ECC 2013, section on identification, (27).
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

from heli_twin.experiment.tree import physics_line
from heli_twin.identification.data import Stretch, stretches
from heli_twin.identification.fit import NEEDS, REMEDY, AxisFit, IdentificationError, Parameter, fit_axis
from heli_twin.recording import Log


class Identified(NamedTuple):
    """A helicopter, identified from its logs."""

    fits: dict[str, AxisFit]
    logs: tuple[str, ...]
    seconds: float
    """Length of the flight that was used."""

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Estimates by the names of `controllers.model.Model`."""
        parameters = {}
        for axis, fit in self.fits.items():
            parameters[f"b_{axis}"] = fit.b
            if fit.k is not None:
                parameters[f"k_{axis}"] = fit.k
        return parameters

    def as_json(self) -> dict[str, Any]:
        """The result as `heli-twin identify --json` prints it."""
        return {
            "parameters": {name: as_json(p) for name, p in self.parameters.items()},
            "delays": {axis: as_json(fit.delay) for axis, fit in self.fits.items()},
            "explained": {axis: fit.explained for axis, fit in self.fits.items()},
            "residual_rms": {axis: fit.residual_rms for axis, fit in self.fits.items()},
            "seconds": self.seconds,
            "logs": list(self.logs),
        }

    def as_toml(self) -> str:
        """A table for `heli-twin fly`: a file of its own, or `controller.model=FILE.toml`."""
        lines = ["# identified from flight logs; 95 % intervals behind", physics_line(), "", "[controller.model]"]
        for name, p in self.parameters.items():
            # The model (1) has no negative damping: an estimate of zero damping may come out on either side of 0.
            value = min(p.value, 0.0) if name.startswith("k") else p.value
            lines.append(f"{name} = {value:.5g}  # {p.low:.5g} to {p.high:.5g}")
        return "\n".join(lines) + "\n"


def identify(logs: Iterable[tuple[str, Log]]) -> Identified:
    """Identify gains and damping (27) from flights.

    Args:
        logs: Name and log of each flight.

    Raises:
        IdentificationError: They say too little about an axis; the message names the axis, the value and the limit.

    Source: Kunz, Huck, Summers, ECC 2013, (27).
    """
    names: list[str] = []
    pieces: list[Stretch] = []
    for name, log in logs:
        names.append(name)
        pieces += stretches(log, name)
    if not pieces:
        raise IdentificationError(
            f"no usable flight in {', '.join(names) or 'no logs'}: it takes 5 s with poses and sent commands, higher "
            f"than 0.2 m; {REMEDY}"
        )
    # Of an input that no recording has, nothing can be said.
    told = [axis for axis in NEEDS if any(axis in piece.axes for piece in pieces)]
    fits = {axis: fit_axis(axis, [piece for piece in pieces if axis in piece.axes]) for axis in told}
    return Identified(fits, tuple(names), sum(float(p.time[-1] - p.time[0]) for p in pieces))


def as_json(p: Parameter) -> dict[str, Any]:
    """An estimate and its interval, for programs."""
    return {"value": p.value, "interval": [p.low, p.high]}
