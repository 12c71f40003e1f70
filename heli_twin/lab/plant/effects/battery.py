"""The battery: its voltage falls with the charge and under load, and with it the thrust."""

from bisect import bisect_right
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from annotated_types import Ge, Gt, Le, Unit, doc

from controllers.signals import Array
from heli_twin.lab.plant import Battery
from heli_twin.lab.plant.effects import Physics, Updates

CHARGES = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
"""Share of the capacity that is left."""
OPEN_VOLTAGES_V = (3.00, 3.45, 3.60, 3.69, 3.74, 3.77, 3.80, 3.84, 3.90, 3.97, 4.06, 4.20)
"""Voltage of a lithium-polymer cell without load at those charges."""


@dataclass(frozen=True, slots=True)
class BatterySpec:
    """One lithium-polymer cell that feeds both rotors.

        I = idle_current + hover_current (T / T_hover)^1.5      power of a rotor in hover
        V = V_open(charge) - resistance I
        thrust / nominal = (V / V_nominal)^1.6
        charge' = -I / capacity

    V_nominal is the voltage of the full cell in hover, so that a flight with a full battery begins with the thrust
    that the plant's `thrust_gain` says. When the voltage falls to `cut_off`, the electronics reduce the thrust by
    `cut_off_loss` for the rest of the flight.

    Source: 1S 110 mAh and 7 to 8 min of flight (Blade mCX2) give a mean of 0.88 A; exponent, resistance and the curve
    are engineering estimates that give 3.9 V loaded and full, 3.4 V and 20 % less thrust at 10 %.
    """

    kind: Literal["battery"] = "battery"
    charge: Annotated[float, Gt(0), Le(1), Unit("1"), doc("share of the capacity left at the start")] = 1.0
    capacity: Annotated[float, Gt(0), Le(10), Unit("A h"), doc("of the full cell")] = 0.110
    resistance: Annotated[float, Ge(0), Le(2), Unit("Ohm"), doc("of the cell and its wires")] = 0.28
    idle_current: Annotated[float, Ge(0), Le(2), Unit("A"), doc("of the electronics and servos")] = 0.06
    hover_current: Annotated[float, Ge(0), Le(2), Unit("A"), doc("of the motors while the thrust is the weight")] = 0.82
    cut_off: Annotated[float, Ge(0), Le(10), Unit("V"), doc("at which the electronics save the cell")] = 3.0
    cut_off_loss: Annotated[float, Ge(0), Le(1), Unit("1"), doc("share of the thrust lost from then on")] = 0.3

    def build(self, model: Any) -> None:
        """Add nothing to the model."""

    def start(self, physics: Physics) -> Updates:
        """Begin under the load of hovering."""
        return Updates(every_period=BatteryInFlight(self, float(physics.trim[2]), physics.actuators).discharge)


class BatteryInFlight:
    """The battery of one flight."""

    def __init__(self, spec: BatterySpec, hover: float, actuators: Array) -> None:
        # The actuators are a view: to look them up takes as long as a physics step.
        self._spec, self._hover, self._actuators = spec, hover, actuators
        self._charge = spec.charge
        # A cell of so great a resistance that hovering takes all its voltage gives no thrust, instead of no number.
        self._nominal = max(open_voltage(1.0) - spec.resistance * (spec.idle_current + spec.hover_current), 1.0)
        self._cut = False
        self._factor = 0.0
        """Thrust as a fraction of nominal of the last period; 0 before the first."""

    def discharge(self, physics: Physics) -> None:
        """Draw the current of the coming period."""
        spec = self._spec
        if self._factor:
            thrust = max(float(self._actuators[2]), 0.0) * self._factor
        else:
            # At the start, the thrust of the trim that all effects together need.
            thrust = 0.0 if physics.stands else float(physics.trim[2])
        current = spec.idle_current + spec.hover_current * (thrust / self._hover) ** 1.5
        voltage = max(open_voltage(self._charge) - spec.resistance * current, 0.0)
        self._cut = self._cut or voltage <= spec.cut_off
        self._factor = (voltage / self._nominal) ** 1.6 * (1.0 - spec.cut_off_loss * self._cut)
        physics.battery = Battery(voltage, current, self._charge)
        physics.thrust *= self._factor
        self._charge = max(self._charge - current * physics.period / (3600.0 * spec.capacity), 0.0)


def open_voltage(charge: float) -> float:
    """Return the voltage without load (V) at a share of the capacity, interpolated linearly."""
    # NumPy's interp takes a hundredth of a flight to read the table again and again.
    above = min(max(bisect_right(CHARGES, charge), 1), len(CHARGES) - 1)
    (low, high), (below, beyond) = CHARGES[above - 1 : above + 1], OPEN_VOLTAGES_V[above - 1 : above + 1]
    return (beyond - below) / (high - low) * (min(max(charge, low), high) - low) + below
