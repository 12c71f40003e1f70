"""A user's MJCF as a text: read with the mesh files beside it, checked and brought into one form, without the engine.

The text is complete: mesh files are in it, packed as `<custom><text name="file:NAME" data="BASE64"/></custom>`. Nothing
else is read when it flies, so that a text from a log follows no path. Elements that multiply themselves, load code or
only change pictures have no place in it.
"""

import binascii
import re
from base64 import b64decode, b64encode
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from xml.etree import ElementTree as ET

from heli_twin.terminal_text import clean

MAX_TEXT_BYTES = 256 * 1024
"""Largest MJCF, without its mesh files."""
MAX_MESH_BYTES = 1024 * 1024
"""Largest sum of mesh files."""
MESH_LIMIT = f"more than {MAX_MESH_BYTES:,} bytes: leave out those that are only looked at, they are drawn as boxes"
MAX_ELEMENTS, MAX_DEPTH = 5000, 40
MAX_ITERATIONS = 200
"""Of the engine's solvers; MuJoCo's default is 100."""

PACKED = "file:"
DROPPED = ("visual", "statistic", "size", "sensor", "texture", "layer", "light", "camera", "numeric", "tuple")
"""Elements that change pictures and measurements, and not the flight."""
KNOWN = (
    *("mujoco", "compiler", "option", "flag", "default", "asset", "mesh", "material", "custom", "text"),
    *("worldbody", "body", "frame", "inertial", "joint", "freejoint", "geom", "site"),
    *("actuator", "general", "motor", "position", "velocity", "damper", "cylinder"),
    *("tendon", "spatial", "fixed", "pulley", "equality", "connect", "weld", "contact", "pair", "exclude"),
    *("keyframe", "key"),
)
REFUSED = {
    "include": "put its text into the file",
    "plugin": "a model loads no code",
    "extension": "a model loads no code",
    **dict.fromkeys(("replicate", "composite", "flexcomp", "attach", "model"), "write its bodies out"),
}
DIRECTORIES = ("meshdir", "texturedir", "assetdir", "strippath")
MESH_ATTRIBUTES = (
    *("name", "class", "file", "vertex", "normal", "texcoord", "face", "refpos", "refquat", "scale", "smoothnormal"),
    *("inertia", "maxhullvert", "material"),
)
_MESH_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_. -]{0,80}\.(stl|obj|msh)", re.IGNORECASE)


def read_text(file: Path) -> str:
    """Read an MJCF and the mesh files that it names, which have to stand in its folder or below.

    Raises:
        OSError: A file cannot be read.
        ValueError: One sentence that says what is not allowed in it.
    """
    root = _parsed(_decoded(_bytes(file, MAX_TEXT_BYTES, "an MJCF")))
    folders = root.findall("compiler")
    below = next((c.get(key, "") for key in ("meshdir", "assetdir") for c in folders if c.get(key)), "")
    packed: dict[str, bytes] = {}
    for mesh in root.iter("mesh"):
        if name := mesh.get("file"):
            path = _beside(file, below, name)
            mesh.set("file", path.name)
            data = _bytes(path, MAX_MESH_BYTES, "mesh files")
            if packed.setdefault(path.name, data) != data:
                raise ValueError(f"has two mesh files of the name {path.name}: rename one")
            if sum(map(len, packed.values())) > MAX_MESH_BYTES:
                raise ValueError(f"names mesh files of {MESH_LIMIT}")
    if packed:
        custom = ET.SubElement(root, "custom")
        for name, data in sorted(packed.items()):
            ET.SubElement(custom, "text", name=PACKED + name, data=b64encode(data).decode())
    return normal_form(ET.tostring(root, encoding="unicode"))


@lru_cache(maxsize=64)
def normal_form(text: str) -> str:
    """Return the text without comments and without what changes no flight, indented.

    Raises:
        ValueError: One sentence that says what is not allowed in it.
    """
    root = _parsed(text)
    _drop(root)
    for element in root.iter():
        _check(element)
        element.text = element.tail = None
    files = _files(root)
    for mesh in root.iter("mesh"):
        name = mesh.get("file")
        if name is not None and name not in files:
            raise ValueError(f"does not hold its mesh file {clean(name, 60)!r}: give the path of the MJCF instead")
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode")


def unpacked(text: str) -> tuple[str, dict[str, bytes]]:
    """Return the MJCF of a text in normal form, and its mesh files by name."""
    root = _parsed(text)
    files = _files(root)
    for custom in root.findall("custom"):
        root.remove(custom)
    return ET.tostring(root, encoding="unicode"), files


@lru_cache(maxsize=64)
def timestep(text: str) -> float:
    """Return the length of the physics step that a text says, s; MuJoCo's default is 0.002."""
    said = [option.get("timestep") for option in _parsed(text).findall("option")]
    value = next((value for value in reversed(said) if value is not None), "0.002")
    try:
        return float(value)
    except ValueError:
        raise ValueError(f"has the timestep {clean(value, 40)!r}, which is no number") from None


class _Guard(ET.TreeBuilder):
    """Refuses deep and endless trees while they are read."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = self._count = 0

    def start(self, tag: str, attrs: dict[str, str], /) -> ET.Element:
        """Begin an element."""
        self._depth, self._count = self._depth + 1, self._count + 1
        if self._depth > MAX_DEPTH:
            raise ValueError(f"is nested deeper than {MAX_DEPTH} elements")
        if self._count > MAX_ELEMENTS:
            raise ValueError(f"has more than {MAX_ELEMENTS} elements")
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        """End an element."""
        self._depth -= 1
        return super().end(tag)


def _parsed(text: str) -> ET.Element:
    most = MAX_TEXT_BYTES + 2 * MAX_MESH_BYTES
    if len(text) > most:
        raise ValueError(f"has {len(text):,} characters: at most {most:,} are allowed")
    if "<" not in text:
        raise ValueError("is no MJCF: give the name of a file that ends in .xml, or its text")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ValueError("has a document type, which can define entities: take it out")
    try:
        parser = ET.XMLParser(target=_Guard())
        parser.feed(text)
        root = parser.close()
    except (ET.ParseError, UnicodeError) as error:
        raise ValueError(f"is not XML: {clean(str(error), 120)}") from None
    if root.tag != "mujoco":
        raise ValueError(f"is no MJCF: its root is <{clean(str(root.tag), 40)}>, not <mujoco>")
    return root


def _drop(parent: ET.Element) -> None:
    for child in list(parent):
        if child.tag in DROPPED:
            parent.remove(child)
        else:
            _drop(child)


def _check(element: ET.Element) -> None:
    tag, attributes = str(element.tag), element.attrib
    if tag in REFUSED:
        raise ValueError(f"has the element <{tag}>: {REFUSED[tag]}")
    if tag not in KNOWN:
        raise ValueError(
            f"has the element <{clean(tag, 40)}>, which an airframe cannot have: known are {', '.join(KNOWN)}"
        )
    if tag == "text":
        if not attributes.get("name", "").startswith(PACKED):
            raise ValueError("has the element <text>, which only holds packed mesh files: take it out")
        _check_name(attributes["name"].removeprefix(PACKED))
    if tag == "compiler":
        for name in DIRECTORIES:
            attributes.pop(name, None)
    attributes.pop("texture", None)
    for name, value in attributes.items():
        if (name == "file" or "plugin" in name) and tag != "mesh":
            raise ValueError(f"has <{tag} {name}={clean(value, 60)!r}>: an airframe reads mesh files and nothing else")
        if name in ("delay", "nsample", "interval"):
            raise ValueError(f"has <{tag} {name}=...>: leave the delay of the sticks to plant.input_delay")
        if tag == "mesh" and name not in MESH_ATTRIBUTES:
            raise ValueError(f"has <mesh {clean(name, 40)}=...>: a mesh may have {', '.join(MESH_ATTRIBUTES)}")
        if name == "file":
            _check_name(value)
        if name.endswith("iterations") and not (value.isdecimal() and len(value) < 9 and int(value) <= MAX_ITERATIONS):
            raise ValueError(f"has <{tag} {name}={clean(value, 20)!r}>: at most {MAX_ITERATIONS} are allowed")
        if name in ("actdim", "sdf_initpoints"):
            raise ValueError(f"has <{tag} {name}=...>: take it out")


def _check_name(name: str) -> None:
    if not _MESH_NAME.fullmatch(name):
        raise ValueError(
            f"names the mesh file {clean(name, 60)!r}: a name beside the MJCF that ends in .stl, .obj or .msh"
        )


def _files(root: ET.Element) -> dict[str, bytes]:
    files: dict[str, bytes] = {}
    for name, data in _packed(root):
        try:
            files[name] = b64decode(data, validate=True)
        except (binascii.Error, ValueError):
            raise ValueError(f"holds the mesh file {clean(name, 60)!r} in no base64") from None
    total = sum(map(len, files.values()))
    if total > MAX_MESH_BYTES:
        raise ValueError(f"holds mesh files of {MESH_LIMIT}")
    return files


def _packed(root: ET.Element) -> Iterator[tuple[str, str]]:
    for text in root.iter("text"):
        yield text.get("name", "").removeprefix(PACKED), text.get("data", "")


def _beside(file: Path, below: str, name: str) -> Path:
    """Return the path of a mesh file in the folder of the MJCF or below."""
    whole = f"{below}/{name}" if below else name
    parts = whole.split("/")
    if "://" in whole or "\\" in whole or ":" in whole or whole.startswith("/") or ".." in parts:
        raise ValueError(
            f"names the mesh file {clean(whole, 60)!r}: it has to stand in the folder of the MJCF or below"
        )
    _check_name(parts[-1])
    folder = file.parent.resolve()
    path = (folder / whole).resolve()
    if not path.is_relative_to(folder):
        raise ValueError(f"names the mesh file {clean(whole, 60)!r}, which is a link out of the folder of the MJCF")
    return path


def _bytes(file: Path, most: int, what: str) -> bytes:
    if file.exists() and not file.is_file():
        raise ValueError(f"cannot be read: {clean(str(file), 200)} is no file")
    with file.open("rb") as stream:
        data = stream.read(most + 1)
    if len(data) > most:
        raise ValueError(f"is too large: {clean(file.name, 60)} has more than the {most:,} bytes that {what} may have")
    return data


def _decoded(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("is not UTF-8 text") from None
