"""How a flight looks in Rerun: what stands where, in which colour, and all that never changes."""

from collections.abc import Iterable, Iterator, Sequence
from math import cos, sin
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from controllers.signals import Array
from heli_twin.recording.shape import FUSELAGE, ROTOR_LOWER, ROTOR_UPPER, STABILISER, Part

TIMELINE = "sim_time"
TRAIL_SECONDS = 2.0
"""How much of the flown path is shown behind the helicopter, s."""

FLOWN, WANTED, PLANNED, BELIEVED, SEEN = 0x4FA3FFFF, 0xD8DCE3FF, 0xFFA62BFF, 0x4CD4A5FF, 0xC58BFFFF
LIMIT, AXES, YAW = 0xFF5A5FFF, (0xFF6B6BFF, 0x7BD389FF, 0x5AA9FFFF), 0xFFD166FF
"""One colour, one meaning: truth, reference, plan and command, estimate, motion capture; limits; x y z; yaw."""
AIR, PLUMB = 0x8FE3FFFF, 0x8A90A080
"""Wind, and the line that drops from the helicopter to the floor."""
INPUTS = ("pitch", "roll", "thrust", "yaw")
POSITIONS = ("x", "y", "z", "yaw")
RUNGS = {"solved": 0x4CD4A5FF, "softened": YAW, "shifted_plan": PLANNED, "safe_hover": LIMIT}
"""Colours of the fallback ladder."""
CONTACT = {"in the air": BELIEVED, "on the floor": YAW}
"""Colours of whether it flies."""


class Scales(NamedTuple):
    """What the plots compare with; it follows from the experiment."""

    u_min: tuple[float, ...] = (-1.0, -1.0, 0.0, -1.0)
    """Lower input limits, fractions of full stick."""
    u_max: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    """Upper input limits, fractions of full stick."""
    period: float = 0.02
    """Control period, s: the deadline of the solver."""
    path: Array | None = None
    """(n, 3) where the flight leads, world, m: what the camera looks at."""


def layout(scales: Scales) -> rrb.Blueprint:
    """Scene, events and controller state to the left, plots to the right."""
    scene = rrb.Vertical(
        _scene(scales.path),
        rrb.Horizontal(
            rrb.TextLogView(
                name="Events", origin="/events", columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"])
            ),
            rrb.StateTimelineView(name="Controller and contact", origin="/state"),
            column_shares=[3, 2],
        ),
        row_shares=[4, 1],
    )
    plots = rrb.Tabs(
        rrb.Vertical(
            _plot("Position error [cm]", "/error/position"),
            _plot("Yaw error [deg]", "/error/yaw"),
            _plot("Input sent [of full stick]", "/input/all"),
            _plot("Computing [ms]", "/computing", y=(0.0, 1.2e3 * scales.period)),
            name="Flight",
            row_shares=[4, 2, 3, 2],
        ),
        rrb.Vertical(
            *(_plot(f"{name} [{'deg' if name == 'yaw' else 'm'}]", f"/position/{name}") for name in POSITIONS),
            name="Position",
        ),
        rrb.Vertical(
            *(
                _plot(f"{name} [of full stick]", f"/input/{name}", y=(low - 0.05, high + 0.05))
                for name, low, high in zip(INPUTS, scales.u_min, scales.u_max, strict=True)
            ),
            name="Inputs",
        ),
        rrb.Vertical(
            _plot("Wind [m/s]", "/air/wind"),
            _plot("Push [m/s^2]", "/air/push"),
            _plot("Thrust [of nominal]", "/air/thrust"),
            name="Air",
        ),
        active_tab=0,
    )
    return rrb.Blueprint(
        rrb.Horizontal(scene, plots, column_shares=[5, 4]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="playing"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _scene(path: Array | None) -> rrb.Spatial3DView:
    points = np.array([[-0.5, -0.5, 1.0], [0.5, 0.5, 1.0]]) if path is None else path
    low, high = points.min(axis=0), points.max(axis=0)
    centre, radius = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 0.4)
    trail = rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_SECONDS),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        name="Flight: blue flown, orange planned, white reference",
        origin="/world",
        background=[24, 26, 31],
        line_grid=rrb.LineGrid3D(spacing=0.5, color=[90, 96, 110, 120]),
        eye_controls=rrb.EyeControls3D(
            position=centre + radius * np.array([-1.6, -1.1, 0.9]), look_target=centre, eye_up=(0.0, 0.0, 1.0)
        ),
        overrides={"/world/trail": [trail]},
    )


def _plot(name: str, origin: str, y: tuple[float, float] | None = None) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        name=name,
        origin=origin,
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=None if y is None else rrb.ScalarAxis(range=y),
        plot_legend=rrb.PlotLegend("LeftTop"),
    )


def send_static(stream: rr.RecordingStream) -> None:
    """The shape of the helicopter, and names and colours of every series."""
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    body = "world/helicopter"
    for path, parts in (
        (f"{body}/fuselage", FUSELAGE),
        (f"{body}/rotor_lower", ROTOR_LOWER),
        (f"{body}/rotor_upper", ROTOR_UPPER + STABILISER),
    ):
        _send_parts(stream, path, parts)
    for path, series in _series():
        names, colours, widths = zip(*series, strict=True)
        held = path.startswith(("input", "air"))
        lines = rr.SeriesLines(
            names=names,
            colors=_rgba(colours),
            widths=widths,
            interpolation_mode=rr.components.InterpolationMode.StepAfter if held else None,
        )
        stream.log(path, lines, static=True)
    for path, width, colour in (
        ("trail", 0.004, FLOWN),
        ("horizon", 0.004, PLANNED),
        ("reference_path", 0.002, WANTED),
    ):
        stream.log(f"world/{path}", rr.LineStrips3D.from_fields(radii=width, colors=_rgba([colour])), static=True)
    stream.log("world/plumb_line", rr.LineStrips3D.from_fields(radii=0.001, colors=_rgba([PLUMB])), static=True)
    for path, radius, colour in (("reference", 0.012, WANTED), ("mocap", 0.006, SEEN)):
        stream.log(f"world/{path}", rr.Points3D.from_fields(radii=radius, colors=_rgba([colour])), static=True)
    stream.log("world/wind", rr.Arrows3D.from_fields(radii=0.003, colors=_rgba([AIR])), static=True)
    for path, colours in ("state/controller", RUNGS), ("state/contact", CONTACT):
        style = rr.StateConfiguration(values=[*colours], colors=_rgba(colours.values()))
        stream.log(path, style, static=True)


Series = tuple[str, int, float]
"""Name, colour and width of one line of a plot."""


def _series() -> Iterator[tuple[str, Sequence[Series]]]:
    """Entity and lines of every plot."""
    axes: list[Series] = [(name, colour, 1.5) for name, colour in zip("xyz", AXES, strict=True)]
    yield "error/position", axes
    yield "error/yaw", [("yaw", YAW, 1.5)]
    yield "input/all", [(name, colour, 1.2) for name, colour in zip(INPUTS, (*AXES, YAW), strict=True)]
    for name in POSITIONS:
        yield f"position/{name}/mocap", [("motion capture", SEEN, 1.0)]
        yield f"position/{name}/estimate", [("estimate", BELIEVED, 1.2)]
        yield f"position/{name}/reference", [("reference", WANTED, 1.2)]
        yield f"position/{name}/truth", [("truth", FLOWN, 2.0)]
    for name in INPUTS:
        yield f"input/{name}/limits", [("lower limit", LIMIT, 1.0), ("upper limit", LIMIT, 1.0)]
        yield f"input/{name}/sent", [("sent", PLANNED, 1.5)]
        yield f"input/{name}/acting", [("acting", FLOWN, 1.5)]
    yield "computing", [("whole step", WANTED, 1.2), ("solver", PLANNED, 1.5), ("deadline", LIMIT, 1.0)]
    yield "air/wind", axes
    yield "air/push", axes
    yield "air/thrust", [("thrust", FLOWN, 1.5)]


def _send_parts(stream: rr.RecordingStream, path: str, parts: Sequence[Part]) -> None:
    """Draw primitives, all of one kind at once."""
    spheres, cylinders, boxes = (
        [part for part in parts if part.kind == kind] for kind in ("sphere", "cylinder", "box")
    )
    solid = rr.components.FillMode.Solid
    if spheres:
        shape = rr.Ellipsoids3D(
            radii=[part.size[0] for part in spheres],
            centers=[part.centre for part in spheres],
            colors=_rgba(part.colour for part in spheres),
            fill_mode=solid,
        )
        stream.log(f"{path}/spheres", shape, static=True)
    if cylinders:
        shape = rr.Cylinders3D(
            radii=[part.size[0] for part in cylinders],
            lengths=[part.size[1] for part in cylinders],
            centers=[part.centre for part in cylinders],
            quaternions=[_quat_xyzw(part.rpy) for part in cylinders],
            colors=_rgba(part.colour for part in cylinders),
            fill_mode=solid,
        )
        stream.log(f"{path}/cylinders", shape, static=True)
    if boxes:
        shape = rr.Boxes3D(
            sizes=[part.size for part in boxes],
            centers=[part.centre for part in boxes],
            quaternions=[_quat_xyzw(part.rpy) for part in boxes],
            colors=_rgba(part.colour for part in boxes),
            fill_mode=solid,
        )
        stream.log(f"{path}/boxes", shape, static=True)


def _rgba(colours: Iterable[int]) -> NDArray[np.uint32]:
    return np.array([*colours], np.uint32)


def _quat_xyzw(rpy: tuple[float, float, float]) -> tuple[float, float, float, float]:
    (cr, cp, cy), (sr, sp, sy) = ([f(angle / 2) for angle in rpy] for f in (cos, sin))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
