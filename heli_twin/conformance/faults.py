"""Rules of faults: on every wire they hook, they pass on what the next part can use."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from controllers.signals import Array, Command, Estimate, Pose
from heli_twin.conformance.rules import require, same
from heli_twin.lab.faults import Hooks
from heli_twin.lab.mocap import Arrival
from heli_twin.lab.plant import Battery, Truth
from heli_twin.lab.plant.ideal import Ideal
from heli_twin.lab.radio import Held

_MS = 1_000_000
_HOVER = np.array([0.1, 0.2, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
_U = np.array([0.1, -0.2, 0.545, 0.03])

Given = tuple[Any, ...]


def _wires(t: int, truth: Truth) -> dict[str, Given]:
    """What each hook of a fault is given at a time, ns."""
    u = _U + 1e-12 * t
    pose = Pose(t, np.array([0.1, 0.2 + 1e-10 * t, 1.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    return {
        "pose": (Arrival(t + 10 * _MS, pose),),
        "estimate": (t, Estimate(t + 22 * _MS, _HOVER.copy(), np.zeros(4), np.full((4, 3), 1e-4), t, 0)),
        "command": (t + 6 * _MS, Command(t, u)),
        "latency": (t, 6 * _MS),
        "received": (t, Held(t, u)),
        "input": (t, u, truth),
        "gyro": (t,),
        "battery": (t, Battery(3.7, 1.5, 0.8)),
        "seen": (t, truth, [truth._replace(position=truth.position + 0.3)]),
    }


def _hooks(fault: Any) -> Hooks:
    hooks = fault.hooks(np.random.default_rng(0))
    require(isinstance(hooks, Hooks), f"hooks() gives a {type(hooks).__name__}, not heli_twin.lab.faults.Hooks")
    return hooks


class _Call(NamedTuple):
    wire: str
    before: Array
    """All numbers that the hook is given, before the call."""
    given: Given
    value: Any


def _flight(fault: Any) -> Iterator[_Call]:
    """Each call of a hook, every 20 ms of 8 s."""
    hooks, truth = _hooks(fault), Ideal().start(_HOVER).truth()
    for t in range(0, 8_000 * _MS, 20 * _MS):
        for wire, given in _wires(t, truth).items():
            if hook := getattr(hooks, wire):
                before = _flat(given)
                yield _Call(wire, before, given, hook(*given))


def _arrival(value: Any, given: Given) -> str:
    if value is None:
        return ""
    whole = isinstance(value, Arrival) and all(type(time) is int for time in (value.at, value.pose.stamp))
    if not whole:
        return "pose has to return an Arrival with whole ns, or None"
    right = value.pose.position.shape == (3,) and value.pose.quat_wxyz.shape == (4,) and value.pose.stamp >= 0
    return "" if right else "a pose has to keep its three coordinates, its four of attitude and a stamp of at least 0"


def _estimate(value: Any, given: Given) -> str:
    if value is None:
        return ""
    if not isinstance(value, Estimate) or value.stamp != given[1].stamp:
        return "estimate has to return an Estimate for the same time, or None"
    return "" if value.x.shape == (8,) else f"an estimate has {value.x.shape} states, not (8,)"


def _commands(value: Any, given: Given) -> str:
    if not isinstance(value, list) or not all(isinstance(one, tuple) and len(one) == 2 for one in value):
        return "command has to return a list of times and commands"
    for at, command in value:
        if not isinstance(at, int) or at < given[0]:
            return f"a command is given to the radio at {at}, and it is ready at {given[0]} ns"
        if not isinstance(command, Command) or not _is_input(command.u):
            return "a command has to keep its four finite inputs"
    return ""


def _latency(value: Any, given: Given) -> str:
    return "" if isinstance(value, int) and value >= 0 else f"latency returns {value!r}: whole ns, at least 0"


def _held(value: Any, given: Given) -> str:
    right = value is None or (isinstance(value, Held) and _is_input(value.u))
    return "" if right else "received has to return a Held with four finite inputs, or None"


def _input(value: Any, given: Given) -> str:
    return "" if _is_input(value) else f"input returns {value!r}, not four finite inputs"


def _gyro(value: Any, given: Given) -> str:
    return "" if isinstance(value, bool | np.bool_) else f"gyro returns {value!r}, not whether it works"


def _battery(value: Any, given: Given) -> str:
    right = value is None or (isinstance(value, Battery) and bool(np.isfinite(value).all()))
    return "" if right else "battery has to return a Battery of finite numbers, or None"


def _seen(value: Any, given: Given) -> str:
    right = isinstance(value, Truth) and value.position.shape == (3,) and value.quat_wxyz.shape == (4,)
    return "" if right else f"seen returns {value!r}, not the state of a helicopter"


def _is_input(u: Any) -> bool:
    return isinstance(u, np.ndarray) and u.shape == (4,) and bool(np.isfinite(u).all())


_TROUBLE: dict[str, Callable[[Any, Given], str]] = {
    "pose": _arrival,
    "estimate": _estimate,
    "command": _commands,
    "latency": _latency,
    "received": _held,
    "input": _input,
    "gyro": _gyro,
    "battery": _battery,
    "seen": _seen,
}


def passes_on_what_the_wire_carries(fault: Any) -> None:
    """On every wire that it hooks, it returns what the next part can use: values of the same kind, finite inputs."""
    for wire, _, given, value in _flight(fault):
        trouble = _TROUBLE[wire](value, given)
        require(not trouble, trouble)


def hooks_a_wire(fault: Any) -> None:
    """It hooks at least one wire."""
    require(any(hook is not None for hook in _hooks(fault)), "hooks() gives no hook: what does it break?")


def breaks_the_same_for_the_same_seed(fault: Any) -> None:
    """The same seed breaks the same, and two flights of one value do not share a state."""
    first, second = ([_flat(call.value) for call in _flight(fault)] for _ in range(2))
    require(same(first, second), "the same seed broke something else: draw from the generator that hooks() gets")


def leaves_what_it_is_given_alone(fault: Any) -> None:
    """It does not change the arrays that it is given: it returns others."""
    for wire, before, given, _ in _flight(fault):
        require(
            np.array_equal(before, _flat(given), equal_nan=True),
            f"it changes what the hook {wire} is given: copy it first",
        )


def _flat(value: Any) -> Array:
    """All numbers in a value, in order."""
    if isinstance(value, list | tuple):
        return np.concatenate([np.zeros(0), *map(_flat, value)])
    if value is None:
        return np.array([np.nan])
    return np.asarray(value, float).ravel()
