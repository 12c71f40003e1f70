"""The views of a flight: which there are, where they stand, and what the camera looks at."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import rerun.blueprint as rrb

from controllers.signals import Array, NamedState
from heli_twin.lab.plant.shape import Primitive
from heli_twin.recording.log import Log
from heli_twin.viewing.style import INPUTS, POSITIONS, Source

TIMELINE = "sim_time"
TRAIL_S = 2.0
"""Length of the flown path that is shown behind the helicopter."""


class Scales(NamedTuple):
    """Values that the plots compare with; they follow from the experiment."""

    u_min: tuple[float, ...] = (-1.0, -1.0, 0.0, -1.0)
    """Lower input limits, fractions of full stick."""
    u_max: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    """Upper input limits, fractions of full stick."""
    period: float = 0.02
    """Control period, s: the deadline of the solver."""
    path: Array | None = None
    """(n, 3) path of the flight, world, m: the camera looks at it."""
    planned: bool = True
    """True if there is a reference to compare the flight with."""

    source: Source = "truth"
    states: tuple[NamedState, ...] = ()
    """Names and units of the estimator's further states."""
    shape: tuple[Primitive, ...] = ()
    """Of the helicopter; empty for the mCX2."""

    def for_source(self, log: Log) -> "Scales":
        """The same for a log as it was read."""
        return self if len(log.truth.time) or not len(log.pose.time) else self._replace(source="cameras")

    def for_log(self, log: Log) -> "Scales":
        """The same for a whole flight; the camera looks at the flown path if there is no planned one."""
        scales = self._replace(states=log.estimate_states)
        if len(log.truth.time) and not len(log.reference.time):
            return scales._replace(path=log.truth.position, planned=False)
        return scales._replace(path=log.reference_paths[0][1]) if self.path is None and log.reference_paths else scales


def layout(scales: Scales) -> rrb.Blueprint:
    """Scene, events and controller state to the left, plots to the right."""
    flown = "flown" if scales.source == "truth" else f"seen by the {scales.source}"
    seen = rrb.Vertical(
        scene(f"Flight: blue {flown}, orange planned, white reference", scales.path),
        rrb.Horizontal(
            rrb.TextLogView(
                name="Events", origin="/events", columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"])
            ),
            rrb.StateTimelineView(name="Controller, supervisor and contact", origin="/state"),
            column_shares=[3, 2],
        ),
        row_shares=[4, 1],
    )
    plots = rrb.Tabs(
        rrb.Vertical(
            plot("Position error [cm]", "/error/position"),
            plot("Yaw error [deg]", "/error/yaw"),
            plot("Input sent [of full stick]", "/input/all"),
            plot("Computing [ms]", "/computing", y=(0.0, 1.2e3 * scales.period)),
            name="Flight",
            row_shares=[4, 2, 3, 2],
        ),
        rrb.Vertical(
            *(plot(f"{name} [{'deg' if name == 'yaw' else 'm'}]", f"/position/{name}") for name in POSITIONS),
            name="Position",
        ),
        rrb.Vertical(
            *(
                plot(f"{name} [of full stick]", f"/input/{name}", y=(low - 0.05, high + 0.05))
                for name, low, high in zip(INPUTS, scales.u_min, scales.u_max, strict=True)
            ),
            name="Inputs",
        ),
        rrb.Vertical(
            plot("Wind [m/s]", "/air/wind"),
            plot("Push [m/s^2]", "/air/push"),
            plot("Thrust [of nominal]", "/air/thrust"),
            name="Air",
        ),
        *([_states(scales)] if scales.states else []),
        active_tab=0 if scales.planned else 1,
    )
    return blueprint(seen, plots)


def _states(scales: Scales) -> rrb.Vertical:
    """Plots of the estimator's further states."""
    views = (plot(f"{state.name} [{state.unit}]", f"/states/{state.name}") for state in scales.states)
    return rrb.Vertical(*views, name="Further states")


def blueprint(seen: rrb.Container, plots: rrb.Container) -> rrb.Blueprint:
    """The scene to the left, plots to the right, and no panels but the time."""
    return rrb.Blueprint(
        rrb.Horizontal(seen, plots, column_shares=[5, 4]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="playing"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def scene(name: str, path: Array | None, flights: Sequence[str] = ("",)) -> rrb.Spatial3DView:
    """The lab in 3D.

    Args:
        name: Title; it explains the colours.
        path: (n, 3) path that the camera looks at, world, m.
        flights: Prefix of each flight's entities, such as `/A`.
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
            position=centre + radius * np.array([-1.35, -0.95, 0.8]), look_target=centre, eye_up=(0.0, 0.0, 1.0)
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
        plot_legend=rrb.PlotLegend("LeftTop"),
    )
