"""What happened in a flight, on the axes of time: outages, faults, phases of the supervisor, the end."""

from collections.abc import Iterator
from typing import Any

from controllers.markers import by_name
from controllers.supervisors import PHASES
from heli_twin.metrics.motion import Span, outages
from heli_twin.plots.runs import Run

TOLD = 8
"""Most events that are named; of more, only lines are drawn."""
OUTAGE_COLOR, FAULT_COLOR, EVENT_COLOR = "#d9d9d9", "#D55E00", "#666666"
LETTER_INCHES = 0.05
"""Width of a letter of an event's name."""
SHORT = {"touch_down": "touch-down"}


def faults(run: Run) -> list[Span]:
    """The faults that come once, s. When those by chance came, a log does not say."""
    spans: list[Span] = []
    for name, fault in by_name(run.experiment.faults).items() if run.experiment else ():
        start, duration = getattr(fault, "start", None), getattr(fault, "duration", None)
        if start is not None and duration is not None and not getattr(fault, "rate", 0.0):
            spans.append(Span(start, start + duration, name))
    return spans


def events(run: Run) -> Iterator[tuple[float, str]]:
    """Time (s) and name of each event that is marked."""
    end = 1e-9 * run.log.ending.time
    for event in run.log.events:
        t = 1e-9 * event.time
        if event.name in PHASES and event.time > 0:
            yield t, event.name
        elif event.name == "touch_down" or (event.name == run.log.outcome != "completed" and t < end + 1):
            yield t, SHORT.get(event.name, event.name)


def mark(axes: Any, run: Run, *, alone: bool, named: bool) -> None:
    """Draw outages, faults and events of a flight.

    Args:
        axes: Of matplotlib, with time in s along x.
        run: The flight.
        alone: Whether it is the only one there; else its marks have its colour.
        named: Whether the events are named above the axes.
    """
    for span in outages(run.log):
        shade = OUTAGE_COLOR if alone else run.color
        axes.axvspan(
            *_within(span, run),
            facecolor=shade,
            alpha=0.6 if alone else 0.12,
            linewidth=0,
            zorder=0.5,
            label="no poses" if alone else None,
        )
    for span in faults(run):
        low, high = _within(span, run)
        axes.plot(
            [low, high],
            [1, 1],
            color=FAULT_COLOR,
            linewidth=3,
            transform=axes.get_xaxis_transform(),
            solid_capstyle="butt",
            label=span.name if alone else None,
            zorder=4,
        )
    shown = [(t, name) for t, name in events(run) if run.start <= t <= run.end]
    for t, _ in shown:
        axes.axvline(t, color=EVENT_COLOR if alone else run.color, linewidth=0.6, linestyle=":", zorder=1)
    if named and len(shown) <= TOLD:
        _name(axes, run, shown)


def _name(axes: Any, run: Run, shown: list[tuple[float, str]]) -> None:
    """Write the names of events above the axes; those that would collide, in one."""
    width = axes.get_position().width * axes.get_figure(root=True).get_figwidth()
    letter = LETTER_INCHES * (run.end - run.start) / width
    groups: list[tuple[float, list[str]]] = []
    for t, name in shown:
        if groups and t < groups[-1][0] + letter * (2 + len(", ".join(groups[-1][1]))):
            groups[-1][1].append(name)
        else:
            groups.append((t, [name]))
    for t, names in groups:
        text = ", ".join(dict.fromkeys(names))
        fits = t + letter * len(text) < run.end
        axes.annotate(
            text,
            (t if fits else run.end, 1.0),
            xycoords=axes.get_xaxis_transform(),
            xytext=(0, 4),
            textcoords="offset points",
            ha="left" if fits else "right",
            fontsize=6,
            color=EVENT_COLOR,
        )


def _within(span: Span, run: Run) -> tuple[float, float]:
    return max(span.start, run.start), max(min(span.end, run.end), run.start)
