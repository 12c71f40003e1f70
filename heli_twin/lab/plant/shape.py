"""Primitives that a drawn helicopter is made of, in its body's frame, lengths in m."""

from typing import Literal, NamedTuple

Triple = tuple[float, float, float]


class Primitive(NamedTuple):
    """One solid: sphere (radius), cylinder about z (radius, length), box (three lengths), ellipsoid (half-axes)."""

    kind: Literal["sphere", "cylinder", "box", "ellipsoid"]
    size: tuple[float, ...]
    centre: Triple
    colour: int
    """RGBA."""
    rpy: Triple = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw from the body's axes to the primitive's, rad."""
