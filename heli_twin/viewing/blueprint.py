"""The views of a flight: which there are, where they stand, and what the camera looks at."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import rerun.blueprint as rrb

from controllers.signals import Array, NamedState
from heli_twin.lab.plant.shape import Primitive
from heli_twin.recording.log import Log
from heli_twin.recording.schema import LogError
from heli_twin.requirements import Requirement
from heli_twin.terminal_text import clean, instead
from heli_twin.viewing.style import INPUTS, POSITIONS, Source

TIMELINE = "sim_time"
BESIDE = np.array([-0.45, -1.75, 0.75])
"""Position of the camera from what it looks at, in units of the path's radius: to the east, so that north is to the
right and a helicopter that flies north is seen from its side."""
TRAIL_S = 2.0
"""Length of the flown path that is shown behind the helicopter."""


MOST_REQUIREMENT_PLOTS = 5
"""Requirements that have a plot; all are in the table."""


class Scales(NamedTuple):
    """Values that the plots compare with; they follow from the experiment, and what is shown from the flight."""

    u_min: tuple[float, ...] = (-1.0, -1.0, 0.0, -1.0)
    """Lower input limits, fractions of full stick."""
    u_max: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    """Upper input limits, fractions of full stick."""
    period: float = 0.02
    """Control period, s: the deadline of the solver."""
    path: Array | None = None
    """(n, 3) path of the flight, world, m: the camera looks at it."""

    source: Source = "truth"
    states: tuple[NamedState, ...] = ()
    """Names and units of the estimator's further states."""
    shape: tuple[Primitive, ...] = ()
    """Of the helicopter; empty for the mCX2."""
    present: frozenset[str] | None = None
    """The entities that have data; None while a flight lasts, when all may get some."""
    required: tuple[Requirement, ...] = ()
    """What the flight must do."""
    ranges: Mapping[str, tuple[float, float]] = {}
    """Range of the y axis of each plot, by its origin; one that is missing follows the data."""

    def shows(self, entity: str) -> bool:
        """Return whether an entity, or one below it, may have data."""
        below = entity.strip("/")
        return self.present is None or any(f"{name}/".startswith(f"{below}/") for name in self.present)

    def for_source(self, log: Log) -> "Scales":
        """The same for a log as it was read."""
        return self if len(log.truth.time) or not len(log.pose.time) else self._replace(source="cameras")

    def for_log(self, log: Log) -> "Scales":
        """The same for a whole flight; the camera looks at the planned path and at the flown one."""
        planned = [self.path] if self.path is not None else [log.reference_paths[0][1]] if log.reference_paths else []
        flown = log.truth.position
        seen = flown[(np.abs(flown) < FARTHEST_M).all(axis=1)]
        paths = [path for path in (*planned, seen) if len(path)]
        return self._replace(states=log.estimate_states, path=np.concatenate(paths) if paths else None)


FARTHEST_M = 4.0
"""A helicopter beyond this has flown away: the camera stays with the lab."""


class Tab(NamedTuple):
    """Plots that are seen together."""

    name: str
    plots: Sequence[rrb.View]
    shares: Sequence[float] = ()
    """Of the height; empty for four in a square, where each is tall enough for numbers at its axis."""

    def container(self) -> rrb.Container:
        """The plots in their places."""
        if self.shares:
            return rrb.Vertical(*self.plots, name=self.name, row_shares=self.shares)
        return rrb.Grid(*self.plots, name=self.name, grid_columns=1 if len(self.plots) < 3 else 2)


def layout(scales: Scales, tab: str = "") -> rrb.Blueprint:
    """Scene, events and controller state to the left, plots to the right.

    Args:
        scales: What to show.
        tab: Name of the plots in front; empty for the first.

    Raises:
        LogError: There is no such tab.
    """
    colours = [
        "blue flown" if scales.source == "truth" else f"blue seen by the {scales.source}",
        *(["orange planned"] if scales.shows("world/horizon") else []),
        *(["white reference"] if scales.shows("world/reference_path") or scales.shows("world/reference") else []),
    ]
    events = rrb.TextLogView(
        name="Events", origin="/events", columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    )
    told = [events, rrb.StateTimelineView(name="States", origin="/state")][: 1 + scales.shows("state")]
    seen = rrb.Vertical(
        scene(f"Flight: {', '.join(colours)}", scales.path),
        rrb.Horizontal(*told, column_shares=[3, 2][: len(told)]),
        row_shares=[3, 1],
    )
    return blueprint(seen, in_tabs(_tabs(scales), tab))


def _tabs(scales: Scales) -> list[Tab]:
    """The tabs of a flight; a plot without data is left out, and a tab without plots."""
    tabs = [
        Tab(
            "Flight",
            [
                _plot(scales, "Position error [cm]: x red, y green, z blue", "/error/position"),
                _plot(scales, "Yaw error [deg]", "/error/yaw"),
                _plot(scales, "Sticks sent: pitch red, roll green, thrust blue, yaw yellow", "/input/all"),
            ],
            [4, 3, 4],
        ),
        Tab(
            "Position",
            [
                _plot(scales, f"{name} [{'deg' if name == 'yaw' else 'm'}]{colours}", f"/position/{name}")
                for name, colours in zip(POSITIONS, position_colours(scales), strict=True)
            ],
        ),
        Tab(
            "Inputs",
            [
                plot(f"{name} [of full stick]{colours}", f"/input/{name}", (low - 0.1, high + 0.1))
                for name, low, high, colours in zip(INPUTS, scales.u_min, scales.u_max, INPUT_COLOURS, strict=True)
            ],
        ),
        Tab(
            "Air",
            [
                _plot(scales, "Wind [m/s]: x red, y green, z blue", "/air/wind"),
                _plot(scales, "Push [m/s^2]: the same colours", "/air/push"),
                _plot(scales, "Thrust [of nominal]", "/air/thrust"),
            ],
            [1, 1, 1],
        ),
        Tab("Computing", [plot(COMPUTING, "/computing", (0.0, 1.2e3 * scales.period))]),
        Tab(
            "Further states", [plot(f"{state.name} [{state.unit}]", f"/states/{state.name}") for state in scales.states]
        ),
        *([requirements_tab(scales.required)] if scales.required else []),
    ]
    return [kept for tab in tabs if (kept := _with_data(tab, scales)).plots]


def requirements_tab(required: Sequence[Requirement], flights: Sequence[str] = ("",)) -> Tab:
    """A table of the verdicts, and of the first requirements the signals that decide.

    Args:
        required: What the flights must do.
        flights: Prefix of each flight's entities, such as `/A`.
    """
    plotted = required[:MOST_REQUIREMENT_PLOTS]
    plots = [
        plot(
            f"{number} {clean(each.name, 30)}: {clean(each.formula, 90)}",
            f"/requirements/{number}" if flights == ("",) else "/",
            contents=[f"+ {flight}/requirements/{number}/**" for flight in flights],
        )
        for number, each in enumerate(plotted, 1)
    ]
    told = rrb.TextDocumentView(name="Requirements", origin="/requirements/told")
    return Tab("Requirements", [told, *plots], [1 + 0.3 * len(required), *(2.0 for _ in plots)])


INPUT_COLOURS = (": sent orange", ": acting blue", ": limits red", "")
"""The colours of the four plots of inputs, told over their titles: a legend would hide a part of the flight."""
COMPUTING = "Computing [ms]: whole step white, solver orange, deadline red"


def position_colours(scales: Scales) -> tuple[str, str, str, str]:
    """The same of the plots of the position."""
    reference = ", reference white" if scales.shows("/position/x/reference") else ""
    cameras = ", cameras violet" if scales.source == "truth" else ""
    estimate = ": estimate green" if scales.shows("/position/x/estimate") else ""
    return f": {scales.source} blue{reference}", f"{estimate}{cameras}", "", ""


def _plot(scales: Scales, name: str, origin: str) -> rrb.TimeSeriesView:
    return plot(name, origin, scales.ranges.get(origin))


def _with_data(tab: Tab, scales: Scales) -> Tab:
    kept = [i for i, view in enumerate(tab.plots) if scales.shows(str(view.origin))]
    return tab._replace(plots=[tab.plots[i] for i in kept], shares=[tab.shares[i] for i in kept] if tab.shares else ())


def in_tabs(tabs: Sequence[Tab], name: str = "") -> rrb.Tabs:
    """The tabs, the named one in front.

    Raises:
        LogError: None has this name.
    """
    names = [tab.name.lower() for tab in tabs]
    if name and name.lower() not in names:
        raise LogError(f"there is no tab {instead(name.lower(), names)}")
    in_front = names.index(name.lower()) if name else 0
    return rrb.Tabs(*(tab.container() for tab in tabs), active_tab=in_front if tabs else None)


def blueprint(seen: rrb.Container, plots: rrb.Container) -> rrb.Blueprint:
    """The scene to the left, plots to the right, and no panels but the time."""
    return rrb.Blueprint(
        rrb.Horizontal(seen, plots, column_shares=[5, 4]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="playing"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def scene(name: str, path: Array | None, flights: Sequence[str] = ("",), *, distance: float = 1.0) -> rrb.Spatial3DView:
    """The lab in 3D.

    Args:
        name: Title; it explains the colours.
        path: (n, 3) path that the camera looks at, world, m.
        flights: Prefix of each flight's entities, such as `/A`.
        distance: Of the camera, times the usual one.
    """
    points = np.array([[-0.5, -0.5, 1.0], [0.5, 0.5, 1.0]]) if path is None else path
    low, high = points.min(axis=0), points.max(axis=0)
    centre, radius = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 0.4)
    trail = rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    alone = len(flights) == 1
    return rrb.Spatial3DView(
        name=name,
        origin=f"{flights[0]}/world" if alone else "/",
        contents=[f"+ {flight}/world/**" for flight in flights],
        background=[24, 26, 31],
        line_grid=rrb.LineGrid3D(spacing=0.5, color=[90, 96, 110, 120]),
        eye_controls=rrb.EyeControls3D(
            position=centre + distance * radius * BESIDE, look_target=centre, eye_up=(0.0, 0.0, 1.0)
        ),
        overrides={f"{flight}/world/trail": [trail] for flight in flights},
    )


def plot(
    name: str, origin: str, y: tuple[float, float] | None = None, contents: Sequence[str] = ("$origin/**",)
) -> rrb.TimeSeriesView:
    """A plot of all entities below the origin, or of the contents."""
    return rrb.TimeSeriesView(
        name=name,
        origin=origin,
        contents=[*contents],
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=None if y is None else rrb.ScalarAxis(range=y),
        # A legend would hide a part of the flight: titles tell the colours.
        plot_legend=rrb.PlotLegend(visible=False),
    )
