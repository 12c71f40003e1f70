"""Values of new fields for experiments of older versions, so that an old experiment flies as it did.

Add a line to `PAST` with every new field of an experiment, and with every changed default. The table has two uses:

- An old text does not have the field. In the experiment of a log or of a study's store, a field that is absent has its
  past value. A TOML file says with `physics = N` at its top for which version it was written (`heli-twin show` and
  `--save` write that line): each field that it leaves out and that changed after version N gets its past value. A TOML
  file without that line gets today's defaults.
- The canonical JSON, which digests and run ids hash, leaves out a new field while it has its past value. So a new field
  changes no digest and no run id of the flights that do not use it.
"""

from collections.abc import Callable, Collection, Iterator
from copy import deepcopy
from typing import Any, NamedTuple

from controllers.markers import EachOf, OneOf
from heli_twin.experiment.families import members
from heli_twin.experiment.fields import fields_of

Tree = dict[str, Any]

PHYSICS_VERSION = 8
"""Part of every run's id. Raise it by hand when the same experiment flies differently than before: then a study flies
its old runs again."""
UNRECORDED_VERSION = 3
"""Physics version of a log that does not record one."""


class Past(NamedTuple):
    """The value of a field in flights of older versions."""

    version: int
    """The first physics version with the new field or default."""
    value: Any
    """Value in flights of older versions, as in a tree: a number, a text, a list, a table."""
    is_new: bool = True
    """True for a new field; False for a field that older versions had too, with `value` as its default."""


_KALMAN = "controllers.estimators.kalman.Kalman"
_SEQUENTIAL = "controllers.coordinations.sequential.Sequential"
_SAFETY = "controllers.supervisors.safety.Safety"
PAST: dict[str, Past] = {
    "heli_twin.lab.plant.mujoco.MuJoCo.effects": Past(5, {}),
    # The plant of an experiment has another default than its class.
    "heli_twin.lab.plant.mujoco.MuJoCo.drag_z": Past(5, 0.0, is_new=False),
    "heli_twin.lab.disturbances.gust.Gust.strength": Past(5, 0.25, is_new=False),
    "heli_twin.lab.radio.Dsm2.failsafe": Past(5, 0.0),
    "heli_twin.lab.radio.Dsm2.failsafe_thrust": Past(5, 0.0),
    "heli_twin.lab.faults.pose_nan.PoseNan.rate": Past(4, 0.0),
    "heli_twin.lab.faults.pose_outage.PoseOutage.rate": Past(4, 0.0),
    f"{_KALMAN}.withstand_faults": Past(4, False),
    f"{_KALMAN}.jump_time": Past(4, 0.6),
    f"{_KALMAN}.stray_speed": Past(4, 1.0),
    f"{_KALMAN}.stray_yaw_rate": Past(4, 5.0),
    f"{_KALMAN}.gust_time": Past(5, 0.7),
    f"{_KALMAN}.mean_time": Past(4, 10.0),
    f"{_KALMAN}.floor": Past(4, 0.0),
    "controllers.estimators.detailed_kalman.DetailedKalman.lift_walk": Past(7, 0.2, is_new=False),
    "heli_twin.experiment.Experiment.noise": Past(6, []),
    "heli_twin.experiment.Experiment.supervisor": Past(5, {"kind": "off"}),
    "heli_twin.experiment.several.Several.transmitters": Past(7, "each"),
    "heli_twin.experiment.several.Several.world": Past(7, "apart"),
    f"{_SEQUENTIAL}.distance": Past(8, 0.45, is_new=False),
    f"{_SEQUENTIAL}.acceleration": Past(8, 0.7, is_new=False),
    f"{_SEQUENTIAL}.turn": Past(8, 0.35, is_new=False),
    f"{_SEQUENTIAL}.haste": Past(8, 2.0),
    f"{_SEQUENTIAL}.stop": Past(8, 1.4),
    f"{_SEQUENTIAL}.ahead": Past(8, 0.5),
    "heli_twin.experiment.Experiment.excitation": Past(5, {"kind": "off"}),
    f"{_SAFETY}.level_after": Past(5, 0.5, is_new=False),
    f"{_SAFETY}.heave_damping": Past(5, 0.0),
    f"{_SAFETY}.seen_sink_speed": Past(5, 1.5),
    f"{_SAFETY}.press": Past(5, 1.5, is_new=False),
    f"{_SAFETY}.linger": Past(5, 36_000.0),
    "controllers.laws.ltv_mpc.LtvMpc.integral_zone": Past(5, 1e9),
    "controllers.laws.pid.Pid.derivative": Past(5, "velocity"),
    "controllers.detailed_model.DetailedModel.servo_play": Past(6, 0.0),
    "controllers.detailed_model.DetailedModel.servo_slew": Past(7, 1e4),
    "controllers.trajectories.circle.Circle.x": Past(7, 0.0),
    "controllers.trajectories.circle.Circle.y": Past(7, 0.0),
    "controllers.trajectories.circle.Circle.phase": Past(7, 0.0),
    "controllers.trajectories.takeoff_and_landing.TakeoffAndLanding.stand": Past(4, 0.0),
}
"""Past values by the field's full name: module, class, field, such as `heli_twin.lab.plant.mujoco.MuJoCo.mass`."""


def add_past(spec: type, tree: Tree) -> None:
    """Add the new fields that a tree of canonical JSON leaves out, with their past values, in place.

    Args:
        spec: Class of the tree.
        tree: A whole tree, changed in place.
    """
    _set_past(spec, tree, lambda past, is_absent, _: past.is_new and is_absent)


def restore_past(spec: type, tree: Tree, version: int, said: Collection[str], under: str = "") -> None:
    """Set each field that changed after a version to its past value, unless the text of that version names the field.

    Args:
        spec: Class of the tree.
        tree: A whole tree, changed in place.
        version: Physics version of the text.
        said: Dotted paths of the fields that the text names.
        under: Dotted path of the table that the text describes; empty for the whole tree.
    """

    def applies(past: Past, _: bool, path: str) -> bool:
        named = any(f"{name}.".startswith(f"{path}.") for name in said)
        return past.version > version and path.startswith(f"{under}." if under else "") and not named

    if version < PHYSICS_VERSION:
        _set_past(spec, tree, applies)


def leave_out_past(spec: type, tree: Tree) -> None:
    """Remove each new field that has its past value from a whole tree, in place.

    Args:
        spec: Class of the tree.
        tree: A whole tree, changed in place.
    """
    changed = _by_class()
    for kind, table, _ in reversed(list(_tables(spec, tree))):
        for field, past in changed.get(_name(kind), {}).items():
            if past.is_new and field in table and table[field] == past.value:
                del table[field]


def _set_past(spec: type, tree: Tree, applies: Callable[[Past, bool, str], bool]) -> None:
    changed = _by_class()
    # A table that is put in here is visited next: a field may have come with a class that has changed since.
    for kind, table, here in _tables(spec, tree):
        for field, past in changed.get(_name(kind), {}).items():
            if applies(past, field not in table, here + field):
                table[field] = deepcopy(past.value)


def _by_class() -> dict[str, dict[str, Past]]:
    index: dict[str, dict[str, Past]] = {}
    for name, past in PAST.items():
        spec, _, field = name.rpartition(".")
        index.setdefault(spec, {})[field] = past
    return index


def _name(spec: type) -> str:
    return f"{spec.__module__}.{spec.__qualname__}"


def _tables(spec: type, table: Any, here: str = "") -> Iterator[tuple[type, Tree, str]]:
    """Yield every table of a tree with its class and its dotted path, outer ones first; other values are skipped."""
    if not isinstance(table, dict):
        return
    yield spec, table, here
    for name, info in fields_of(spec).items():
        inner = table.get(name)
        if info.is_plain or not isinstance(inner, dict):
            continue
        match info.family:
            case None:
                yield from _tables(info.type, inner, f"{here}{name}.")
            case OneOf(package):
                kind = members(package).get(str(inner.get("kind")))
                if kind:
                    yield from _tables(kind, inner, f"{here}{name}.")
            case EachOf(package):
                for key, member in inner.items():
                    kind = members(package).get(str(member.get("kind", key)) if isinstance(member, dict) else key)
                    if kind:
                        yield from _tables(kind, member, f"{here}{name}.{key}.")
