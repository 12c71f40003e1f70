"""The strip below the pictures of a film: the error over the flight, and where the film is in it; drawn by Pillow."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from controllers.signals import Array
from heli_twin.films.flights import PLAN_COLOR, REFERENCE_COLOR, Shown
from heli_twin.terminal_text import clean

WHITE, INK, FAINT, LOST = (255, 255, 255), (40, 40, 40), (200, 200, 200), (217, 217, 217)
SHARE = 0.13
"""Of the height of the frame."""
LEAST_SCALE_M = 0.01
NAME_LIMIT = 48


def strip_height(height: int) -> int:
    """Pixels of a strip in a frame of this height; even, as the encoder wants it."""
    return 2 * max(16, round(SHARE * height / 2))


class Axes(NamedTuple):
    """What the strips of a film share."""

    start: float
    """s."""
    end: float
    top: float
    """Distance at the upper border, m."""


def axes(flights: Sequence[Shown], start: float, end: float) -> Axes:
    """Axes that hold the distances of all flights from start to end, s."""
    most = [float(flight.distance(start, end)[1].max(initial=LEAST_SCALE_M)) for flight in flights]
    return Axes(start, end, max(most))


class Strip:
    """The strip of one flight."""

    def __init__(
        self, flight: Shown, width: int, height: int, axes: Axes, tell: Callable[[Array], str] | None = None
    ) -> None:
        """Draw what does not change.

        Args:
            flight: The flight.
            width: Pixels.
            height: Pixels.
            axes: What the strips of the film share.
            tell: Says an error (4,) in a few words; None for distance and yaw.
        """
        self._flight, self._axes, self._tell = flight, axes, tell or _told
        self._size = max(9, round(0.26 * height))
        self._font, self._small = (
            ImageFont.load_default(self._size),
            ImageFont.load_default(max(8, round(0.2 * height))),
        )
        self._scale = f"{100 * axes.top:.3g} cm"
        margin = round(0.15 * height)
        self._left, self._right = (
            round(8.2 * self._size),
            width - 2 * margin - round(self._small.getlength(self._scale)),
        )
        self._top, self._bottom = round(0.12 * height), height - round(0.14 * height)
        self._base = Image.new("RGB", (width, height), WHITE)
        self._draw_base()

    def _x(self, t: float) -> float:
        share = (t - self._axes.start) / (self._axes.end - self._axes.start)
        return self._left + min(max(share, 0.0), 1.0) * (self._right - self._left)

    def _draw_base(self) -> None:
        draw, flight, axes = ImageDraw.Draw(self._base), self._flight, self._axes
        for span in flight.lost:
            if span.end > axes.start and span.start < axes.end:
                draw.rectangle((self._x(span.start), self._top, self._x(span.end), self._bottom), fill=LOST)
        draw.line((self._left, self._bottom, self._right, self._bottom), fill=FAINT)
        time, distance = flight.distance(axes.start, axes.end)
        if len(time):
            y = self._bottom - distance / axes.top * (self._bottom - self._top)
            draw.line(list(zip(map(self._x, time.tolist()), y.tolist(), strict=True)), fill=flight.color, width=2)
            draw.text((self._right + 0.5 * self._size, self._top), self._scale, fill=INK, font=self._small)

    def at(self, t: float) -> Image.Image:
        """The strip at a time, s."""
        picture = self._base.copy()
        draw = ImageDraw.Draw(picture)
        x = self._x(t)
        draw.line((x, self._top, x, self._bottom), fill=INK, width=2)
        time, error = self._flight.error
        lines = [f"{t:6.2f} s"]
        if len(time) and time[0] <= t <= time[-1] + 0.05:
            now = error[min(int(np.searchsorted(time, t)), len(time) - 1)]
            lines.append(self._tell(now))
        elif t > self._flight.end:
            lines.append(self._flight.log.outcome.replace("_", " "))
        for i, line in enumerate(lines):
            draw.text((0.4 * self._size, self._top + i * 1.25 * self._size), line, fill=INK, font=self._font)
        return picture


def _told(error: Array) -> str:
    return f"{100 * float(np.linalg.norm(error[:3])):.1f} cm  {np.degrees(error[3]):+.1f}°"


def titled(picture: Image.Image, flight: Shown, size: int) -> Image.Image:
    """A picture with the flight's name and the meaning of the colours written into its corner."""
    draw, font = ImageDraw.Draw(picture), ImageFont.load_default(size)
    draw.text((size, 0.8 * size), clean(flight.name, NAME_LIMIT), fill=INK, font=font)
    flown = "cameras" if flight.moved.by_cameras else "flown"
    x = float(size)
    keys = [(flown, flight.color), ("reference", REFERENCE_COLOR), ("plan", PLAN_COLOR)]
    for text, shade in keys[: 3 if len(flight.log.plan.time) else 2 if len(flight.path) else 1]:
        draw.text((x, 2.1 * size), text, fill=shade, font=font)
        x += font.getlength(text + "  ")
    return picture
