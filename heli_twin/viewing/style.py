"""Colours, names and shapes of a flight in Rerun: everything that does not change with time."""

from collections.abc import Iterable, Iterator, Sequence
from math import cos, sin
from typing import Literal, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from controllers.signals import Array
from heli_twin.lab.plant.shape import Primitive
from heli_twin.recording.shape import FUSELAGE, RED, ROTOR_LOWER, ROTOR_UPPER, STABILISER

FLOWN, WANTED, PLANNED, BELIEVED, SEEN = 0x4FA3FFFF, 0xD8DCE3FF, 0xFFA62BFF, 0x4CD4A5FF, 0xC58BFFFF
LIMIT, AXES, YAW = 0xFF5A5FFF, (0xFF6B6BFF, 0x7BD389FF, 0x5AA9FFFF), 0xFFD166FF
"""One colour, one meaning: truth, reference, plan and command, estimate, motion capture; limits; x y z; yaw."""
AIR, PLUMB, MARK = 0x8FE3FFFF, 0x8A90A080, 0xB9BFCAFF
"""Wind, the line that drops from the helicopter to the floor, and the arrow on the floor."""
NORTH = (1.0, 0.0, 0.0)
INPUTS = ("pitch", "roll", "thrust", "yaw")
POSITIONS = ("x", "y", "z", "yaw")
QP_STATUS_COLOURS = {"solved": 0x4CD4A5FF, "softened": YAW, "shifted_plan": PLANNED, "safe_hover": LIMIT}
"""By how a control problem was solved."""
PHASE_COLOURS = {
    **dict.fromkeys(("ready", "landed"), YAW),
    "flying": BELIEVED,
    **dict.fromkeys(("coasting", "levelling"), PLANNED),
    "landing": LIMIT,
}
"""By the phase that the supervisor is in."""
CONTACT_COLOURS = {"in the air": BELIEVED, "on the floor": YAW}
"""By whether the helicopter flies."""
RIVAL, RIVAL_WANTED = 0xFF7AC6FF, 0xF3C9E2FF
"""Truth and reference of the second of two flights in one picture."""
Source = Literal["truth", "cameras"]
"""The source of the helicopter's positions; of an imported recording nobody knows the truth."""

NAME_OFFSET = (0.0, 0.0, 0.14)
"""Position of a name over its helicopter, m."""


class Look(NamedTuple):
    """The name and the colours that tell one of several flights from the others."""

    name: str = ""
    """Also the entity above all entities of the flight; empty for a flight alone."""
    colour: str = "blue"
    """Of what was flown, in words."""
    flown: int = FLOWN
    wanted: int = WANTED
    body: int = RED

    def path(self, entity: str) -> str:
        """The path of an entity of this flight."""
        return f"{self.name}/{entity}" if self.name else entity


ALONE = Look()


def send_static(
    stream: rr.RecordingStream,
    look: Look = ALONE,
    source: Source = "truth",
    shape: Sequence[Primitive] = (),
    floor: Array | None = None,
) -> None:
    """Send what does not change with time.

    Args:
        stream: Of Rerun.
        look: Name and colours of the flight.
        source: Of its positions.
        shape: Of the helicopter; empty for the mCX2.
        floor: Beginning of the arrow on the floor; None for none.
    """
    stream.log(look.path("world"), rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    _send_scene(stream, look, shape)
    if floor is not None:
        arrow = rr.Arrows3D(
            origins=[floor], vectors=[NORTH], radii=0.006, colors=rgba([MARK]), labels=["north, 1 m"], show_labels=True
        )
        stream.log(look.path("world/floor"), arrow, static=True)
    for path, series in _series(source):
        names, colours, widths = zip(*series, strict=True)
        held = path.startswith(("input", "air"))
        stream.log(look.path(path), lines(names, colours, widths, held=held), static=True)
    for path, colours in (
        ("state/controller", QP_STATUS_COLOURS),
        ("state/supervisor", PHASE_COLOURS),
        *([("state/contact", CONTACT_COLOURS)] if source == "truth" else []),
    ):
        style = rr.StateConfiguration(values=[*colours], colors=rgba(colours.values()))
        stream.log(look.path(path), style, static=True)


def floor_mark(path: Array | None) -> Array:
    """The beginning (3,) of an arrow on the floor, world, m, that is a metre long and points north: behind the path."""
    points = np.zeros((1, 3)) if path is None else path
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return np.array([middle[0] - 0.5, points[:, 1].max() + 0.3, 0.003])


def lines(
    names: Sequence[str], colours: Sequence[int], widths: float | Sequence[float] = 1.5, *, held: bool = False
) -> rr.SeriesLines:
    """The style of a plot's lines; `held` ones are steps."""
    mode = rr.components.InterpolationMode.StepAfter if held else None
    return rr.SeriesLines(names=names, colors=rgba(colours), widths=widths, interpolation_mode=mode)


def _send_scene(stream: rr.RecordingStream, look: Look, shape: Sequence[Primitive]) -> None:
    body = look.path("world/helicopter")
    fuselage = [part._replace(colour=look.body) if part.colour == RED else part for part in FUSELAGE]
    mcx2 = {"fuselage": fuselage, "rotor_lower": ROTOR_LOWER, "rotor_upper": ROTOR_UPPER + STABILISER}
    for name, parts in ({"fuselage": _told_apart(shape, look)} if shape else mcx2).items():
        _send_parts(stream, f"{body}/{name}", parts)
    for path, width, colour in (
        ("trail", 0.004, look.flown),
        ("horizon", 0.006, PLANNED),
        ("reference_path", 0.002, look.wanted),
        ("plumb_line", 0.001, PLUMB),
    ):
        strip = rr.LineStrips3D.from_fields(radii=width, colors=rgba([colour]))
        stream.log(look.path(f"world/{path}"), strip, static=True)
    for path, radius, colour in (("reference", 0.012, look.wanted), ("mocap", 0.006, SEEN)):
        point = rr.Points3D.from_fields(radii=radius, colors=rgba([colour]))
        stream.log(look.path(f"world/{path}"), point, static=True)
    stream.log(look.path("world/wind"), rr.Arrows3D.from_fields(radii=0.003, colors=rgba([AIR])), static=True)
    if look.name:
        name = rr.Points3D([NAME_OFFSET], labels=[look.name], colors=rgba([look.flown]), radii=0.001, show_labels=True)
        stream.log(f"{body}/name", name, static=True)


def _told_apart(shape: Sequence[Primitive], look: Look) -> Sequence[Primitive]:
    """A user's shape; one of two flights in its colour, as far as it is not translucent."""
    if not look.name:
        return shape
    return [part._replace(colour=look.body) if part.colour & 0xFF == 0xFF else part for part in shape]


Series = tuple[str, int, float]
"""Name, colour and width of one line of a plot."""


def _series(source: Source) -> Iterator[tuple[str, Sequence[Series]]]:
    """Entity and lines of every plot."""
    axes: list[Series] = [(name, colour, 1.5) for name, colour in zip("xyz", AXES, strict=True)]
    yield "error/position", axes
    yield "error/yaw", [("yaw", YAW, 1.5)]
    yield "input/all", [(name, colour, 1.2) for name, colour in zip(INPUTS, (*AXES, YAW), strict=True)]
    for name in POSITIONS:
        yield f"position/{name}/mocap", [("motion capture", SEEN, 1.0)]
        yield f"position/{name}/estimate", [("estimate", BELIEVED, 1.2)]
        yield f"position/{name}/reference", [("reference", WANTED, 1.2)]
        yield f"position/{name}/{source}", [(source, FLOWN, 2.0)]
    for name in INPUTS:
        yield f"input/{name}/limits", [("lower limit", LIMIT, 1.0), ("upper limit", LIMIT, 1.0)]
        yield f"input/{name}/sent", [("sent", PLANNED, 1.5)]
        yield f"input/{name}/acting", [("acting", FLOWN, 1.5)]
    yield "computing", [("whole step", WANTED, 1.2), ("solver", PLANNED, 1.5), ("deadline", LIMIT, 1.0)]
    yield "air/wind", axes
    yield "air/push", axes
    yield "air/moment", axes
    yield "air/thrust", [("thrust", FLOWN, 1.5)]


def _send_parts(stream: rr.RecordingStream, path: str, parts: Sequence[Primitive]) -> None:
    """Draw primitives, all of one kind together."""
    spheres, cylinders, boxes, ellipsoids = (
        [part for part in parts if part.kind == kind] for kind in ("sphere", "cylinder", "box", "ellipsoid")
    )
    solid = rr.components.FillMode.Solid
    if ellipsoids:
        shape = rr.Ellipsoids3D(
            half_sizes=[part.size for part in ellipsoids],
            centers=[part.centre for part in ellipsoids],
            quaternions=[_quat_xyzw(part.rpy) for part in ellipsoids],
            colors=rgba(part.colour for part in ellipsoids),
            fill_mode=solid,
        )
        stream.log(f"{path}/ellipsoids", shape, static=True)
    if spheres:
        shape = rr.Ellipsoids3D(
            radii=[part.size[0] for part in spheres],
            centers=[part.centre for part in spheres],
            colors=rgba(part.colour for part in spheres),
            fill_mode=solid,
        )
        stream.log(f"{path}/spheres", shape, static=True)
    if cylinders:
        shape = rr.Cylinders3D(
            radii=[part.size[0] for part in cylinders],
            lengths=[part.size[1] for part in cylinders],
            centers=[part.centre for part in cylinders],
            quaternions=[_quat_xyzw(part.rpy) for part in cylinders],
            colors=rgba(part.colour for part in cylinders),
            fill_mode=solid,
        )
        stream.log(f"{path}/cylinders", shape, static=True)
    if boxes:
        shape = rr.Boxes3D(
            sizes=[part.size for part in boxes],
            centers=[part.centre for part in boxes],
            quaternions=[_quat_xyzw(part.rpy) for part in boxes],
            colors=rgba(part.colour for part in boxes),
            fill_mode=solid,
        )
        stream.log(f"{path}/boxes", shape, static=True)


def rgba(colours: Iterable[int]) -> NDArray[np.uint32]:
    """Colours as Rerun takes them."""
    return np.array([*colours], np.uint32)


def _quat_xyzw(rpy: tuple[float, float, float]) -> tuple[float, float, float, float]:
    (cr, cp, cy), (sr, sp, sy) = ([f(angle / 2) for angle in rpy] for f in (cos, sin))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
