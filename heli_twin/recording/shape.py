"""The drawn shape of the mCX2: a few primitives, body frame, origin at the centre of gravity.

The URDF in every log and the Rerun scene are both made from these lists. Lengths in m.
"""

from functools import lru_cache
from math import pi
from xml.etree import ElementTree as ET

from heli_twin.lab.plant.shape import Primitive

RED, WHITE, DARK, METAL, TIP = 0xD93A26FF, 0xF2F2EDFF, 0x3A3C42FF, 0xA0A4ABFF, 0xFACC1FFF
DISC = 0x6FA8DC10

_ALONG_X, _ALONG_Y = (0.0, pi / 2, 0.0), (pi / 2, 0.0, 0.0)
_CANOPY = [0.036 - 0.004 * i for i in range(24)]
"""Positions along x of the spheres that form the canopy: a URDF has no ellipsoid."""

FUSELAGE = (
    *(Primitive("sphere", (0.0225 - 0.27 * abs(x - 0.012),), (x, 0.0, -0.0068 - 0.1 * x), RED) for x in _CANOPY),
    Primitive("sphere", (0.0165,), (0.034, 0.0, -0.0065), DARK),
    Primitive("box", (0.05, 0.034, 0.006), (0.018, 0.0, -0.028), WHITE),
    Primitive("cylinder", (0.003, 0.075), (-0.086, 0.0, 0.002), DARK, _ALONG_X),
    Primitive("box", (0.022, 0.003, 0.05), (-0.121, 0.0, 0.010), RED),
    Primitive("box", (0.017, 0.060, 0.002), (-0.102, 0.0, 0.0035), WHITE),
    *(Primitive("cylinder", (0.0018, 0.09), (0.006, y, -0.0435), DARK, _ALONG_X) for y in (-0.029, 0.029)),
    *(Primitive("cylinder", (0.0015, 0.058), (x, 0.0, -0.038), DARK, _ALONG_Y) for x in (0.034, -0.018)),
    Primitive("cylinder", (0.002, 0.064), (0.0, 0.0, 0.042), METAL),
)
"""The primitives that do not turn."""


def _rotor(height: float) -> tuple[Primitive, ...]:
    return (
        Primitive("cylinder", (0.095, 0.0008), (0.0, 0.0, height), DISC),
        Primitive("cylinder", (0.0065, 0.006), (0.0, 0.0, height), METAL),
        Primitive("box", (0.17, 0.015, 0.0016), (0.0, 0.0, height), DARK),
        *(Primitive("box", (0.012, 0.0155, 0.002), (x, 0.0, height), TIP) for x in (-0.089, 0.089)),
    )


ROTOR_LOWER, ROTOR_UPPER = _rotor(0.028), _rotor(0.054)
"""Two rotors that turn in opposite directions about the body's z axis."""
STABILISER = (
    Primitive("cylinder", (0.0015, 0.11), (0.0, 0.0, 0.072), METAL, _ALONG_Y),
    *(Primitive("sphere", (0.004,), (0.0, y, 0.072), METAL) for y in (-0.055, 0.055)),
)
"""The bar above the upper rotor, which turns with it."""


@lru_cache(maxsize=16)
def urdf(name: str, root: str, parts: tuple[Primitive, ...] = ()) -> str:
    """A helicopter as a URDF whose one moving link is `name`, its parent `root`.

    Args:
        name: Of the link.
        root: Of its parent.
        parts: Its shape; empty for the mCX2.
    """
    robot = ET.Element("robot", name="airframe" if parts else "mCX2")
    ET.SubElement(robot, "link", name=root)
    joint = ET.SubElement(robot, "joint", name="flight", type="floating")
    ET.SubElement(joint, "parent", link=root)
    ET.SubElement(joint, "child", link=name)
    link = ET.SubElement(robot, "link", name=name)
    lower = [part._replace(rpy=(0.0, 0.0, 1.2)) for part in ROTOR_LOWER[:3]]
    for part in parts or (*FUSELAGE, *lower, *ROTOR_UPPER, *STABILISER):
        visual = ET.SubElement(link, "visual")
        ET.SubElement(visual, "origin", xyz=_text(part.centre), rpy=_text(part.rpy))
        geometry = ET.SubElement(visual, "geometry")
        match part.kind:
            case "sphere":
                ET.SubElement(geometry, "sphere", radius=_text(part.size))
            case "cylinder":
                ET.SubElement(geometry, "cylinder", radius=_text(part.size[:1]), length=_text(part.size[1:]))
            case "box":
                ET.SubElement(geometry, "box", size=_text(part.size))
            case "ellipsoid":
                # A URDF has none: a box of the same volume.
                ET.SubElement(
                    geometry, "box", size=_text(tuple(2.0 * (pi / 6) ** (1 / 3) * half for half in part.size))
                )
        material = ET.SubElement(visual, "material", name=f"{part.colour:08x}")
        ET.SubElement(material, "color", rgba=_text(tuple(byte / 255 for byte in part.colour.to_bytes(4, "big"))))
    return ET.tostring(robot, encoding="unicode")


def _text(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:.5g}" for number in numbers)
