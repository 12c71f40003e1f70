"""A film of several helicopters: all in one picture, and below it how near they come to each other."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from controllers.signals import Array
from heli_twin.films.flights import CameraKind, Shown, cameras, drawing, pose, rgba, shown
from heli_twin.films.strip import INK, Axes, Strip, axes, strip_height
from heli_twin.lab.plant.renderer import Ball, Camera, Line, Renderer
from heli_twin.metrics.several import CYLINDER_HEIGHT_M, flown_paths, least_over_time, promised_distance
from heli_twin.recording import Log

RIM_POINTS, PLAN_POINTS = 33, 20


def shown_ships(log: Log) -> list[Shown]:
    """Prepare the helicopters of a log, each in a colour of its own.

    Raises:
        HeliTwinError: One has no positions.
    """
    ships = [shown(log.ship(name), name, i) for i, name in enumerate(log.ships)]
    # All together have as many points as a few flights.
    return [ship._replace(path=ship.path[:: max(1, len(ships) // 4)]) for ship in ships]


def room_of(log: Log, ships: Sequence[Shown]) -> Shown:
    """Return all helicopters as one flight whose error is the least distance of any two, for the strip below."""
    time, least = least_over_time(flown_paths({name: log.ship(name) for name in log.ships}))
    distances = np.zeros((len(time), 4))
    distances[:, 0] = least
    longest = max(ships, key=lambda ship: ship.end)
    return longest._replace(name="", error=(time, distances), lost=[], color="#1a1a1a")


def frames_of_ships(
    stack: ExitStack, log: Log, ships: Sequence[Shown], view: tuple[CameraKind, tuple[int, int]], times: Array
) -> Iterator[Image.Image]:
    """Yield the pictures of a film; the renderer closes with the stack.

    Args:
        stack: Closes the renderer.
        log: Of all helicopters.
        ships: The same, prepared.
        view: Kind of the camera; width and height of the film, pixels.
        times: (n,) of the pictures, s.
    """
    camera, (width, height) = view
    below = strip_height(height)
    renderer = stack.enter_context(Renderer(ships[0].plant, width, height - below))
    room = room_of(log, ships)
    shared: Axes = axes([room], float(times[0]), float(max(times[-1], times[0] + 0.1)))
    strip = Strip(room, width, below, shared, _least)
    placed, rings = cameras(ships, camera, times, width / (height - below)), cylinder(promised_distance(log))
    for frame, t in enumerate(times.tolist()):
        looks = placed.at(0, frame)
        if camera == "follow":
            # One camera has all in its picture: it looks at their middle.
            middle = np.mean([placed.at(i, frame).target for i in range(len(ships))], axis=0)
            spread = max(float(np.linalg.norm(placed.at(i, frame).target - middle)) for i in range(len(ships)))
            looks = Camera(middle, looks.distance + 2.5 * spread, looks.azimuth, looks.elevation)
        whole = Image.new("RGB", (width, height), (255, 255, 255))
        whole.paste(_scene(renderer, ships, looks, (t, rings)), (0, 0))
        whole.paste(strip.at(t), (0, height - below))
        yield whole


def _least(error: Array) -> str:
    return f"least {100 * float(error[0]):.0f} cm"


def cylinder(diameter: float) -> Array:
    """Return the two rims (2, n, 3) of an upright cylinder about the origin, m."""
    angles = np.linspace(0.0, 2.0 * np.pi, RIM_POINTS)
    rim = 0.5 * diameter * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    return rim + np.array([[[0.0, 0.0, -0.5]], [[0.0, 0.0, 0.5]]]) * CYLINDER_HEIGHT_M


def planned_ahead(ship: Shown, t: float) -> list[Array]:
    """Return the points (n, 3) of the plan that a helicopter is committed to at t, s; none while it flies its wish."""
    newest = next((each for each in reversed(ship.log.committed) if 1e-9 * each.time <= t), None)
    if newest is None or newest.plan is None or t > ship.end:
        return []
    plan = newest.plan
    times = np.linspace(t, max(t, 1e-9 * (plan.start + plan.step * (len(plan.knots) - 1))), PLAN_POINTS)
    return [plan.flat(times).z[:, :3]]


def _scene(renderer: Renderer, ships: Sequence[Shown], camera: Camera, at: tuple[float, Array]) -> Image.Image:
    t, rings = at
    poses = [pose(ship, t) for ship in ships]
    lines: list[Line] = []
    balls: list[Ball] = []
    for ship, here in zip(ships, poses, strict=True):
        its_lines, its_balls = drawing(ship, t, here.position)
        lines += its_lines
        lines += [Line(ring + here.position, rgba(ship.color), 1.0) for ring in rings]
        lines += [Line(path, rgba(ship.color), 1.5) for path in planned_ahead(ship, t)]
        balls += its_balls
    first, *others = poses
    picture = Image.fromarray(renderer.draw(first, camera, lines, balls, others))
    draw, size = ImageDraw.Draw(picture), max(9, round(0.032 * picture.height))
    font, x, y = ImageFont.load_default(size), float(size), 2.1 * size
    draw.text((x, 0.8 * size), f"{len(ships)} helicopters", fill=INK, font=font)
    for ship in ships:
        if x + font.getlength(ship.name) > picture.width - size:
            x, y = float(size), y + 1.3 * size
        draw.text((x, y), ship.name, fill=ship.color, font=font)
        x += font.getlength(ship.name + "  ")
    return picture
