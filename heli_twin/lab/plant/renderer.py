"""Pictures of a helicopter, drawn by MuJoCo's renderer without a screen.

Nothing is simulated here: the geoms of the model are put where a log says that the helicopter was. Importing this
module loads neither the engine nor a graphics library; making a `Renderer` does.
"""

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from itertools import pairwise
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.signals import Array
from heli_twin.errors import HeliTwinError
from heli_twin.lab.plant.airframe import Airframe
from heli_twin.lab.plant.mujoco import MuJoCo, edited, engine
from heli_twin.lab.plant.twin import rotated_to_world

SAMPLES = 4
"""Of each pixel, against stairs at edges; a software renderer takes twice as long as for one sample."""
MOST_GEOMS = 20_000
ROTORS = {"rotor_lower": 1.0, "rotor_upper": -1.0}
"""Bodies that turn, and their direction."""
SQUARE_M = 0.25
"""Side of a square of the floor."""
HORIZON, ZENITH = (0.93, 0.95, 0.97), (0.72, 0.82, 0.92)
FLOOR_LIGHT, FLOOR_DARK = (0.80, 0.82, 0.85), (0.72, 0.75, 0.79)
FIELD_OF_VIEW_DEG = 40.0
"""From the lower to the upper border of a picture."""
DRIVERS = ("egl", "osmesa", "cgl", "glfw")
NO_GRAPHICS = (
    "no picture can be drawn here, since MuJoCo finds no graphics driver ({why}): on Debian and Ubuntu"
    " `apt install libegl1 libgl1-mesa-dri` draws without a screen and without a graphics card"
)


class Line(NamedTuple):
    """A line in space."""

    points: Array
    """(n, 3) world, m."""
    rgba: tuple[float, float, float, float]
    width: float = 2.0
    """Pixels."""


class Ball(NamedTuple):
    """A ball in space."""

    centre: Array
    """(3,) world, m."""
    rgba: tuple[float, float, float, float]
    radius: float = 0.012
    """m."""


class Camera(NamedTuple):
    """A place to look from."""

    target: Array
    """(3,) point in the middle of the picture, world, m."""
    distance: float
    """m."""
    azimuth: float
    """Direction in which it looks, deg from north to west."""
    elevation: float
    """deg; -90 looks straight down."""


class Pose(NamedTuple):
    """Where the helicopter is."""

    position: Array
    """(3,) world, m."""
    quat_wxyz: Array
    """(4,) body in world, scalar first."""
    rotor_angle: float = 0.0
    """Of the lower rotor, rad; the upper one turns against it."""


class Renderer:
    """Draws one helicopter, or several, over a floor. Close it, or use it as a context."""

    def __init__(self, plant: Any, width: int, height: int) -> None:
        """Load the model and the graphics driver.

        Args:
            plant: The plant of an experiment: a helicopter of a user's own looks like itself, all others as the mCX2.
            width: Of the picture, pixels.
            height: Of the picture, pixels.

        Raises:
            HeliTwinError: There is no graphics driver.
        """
        mujoco = _engine()
        spec = _drawn(plant)
        spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
        quality = spec.visual.quality
        quality.offsamples, quality.shadowsize, quality.numslices, quality.numstacks = SAMPLES, 0, 24, 16
        self._size = (width, height)
        self._model = model = spec.compile()
        model.mat_reflectance[:] = 0.0
        self._data = data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        self._remember()
        self._context: Any = None
        self._gl = _graphics(width, height)
        self._gl.make_current()
        try:
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        except (mujoco.FatalError, RuntimeError) as error:
            self._gl.free()
            raise HeliTwinError(NO_GRAPHICS.format(why=str(error)[:80])) from None
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene = scene = mujoco.MjvScene(model, maxgeom=MOST_GEOMS)
        flags = mujoco.mjtRndFlag
        for flag in (flags.mjRND_REFLECTION, flags.mjRND_SHADOW, flags.mjRND_HAZE):
            scene.flags[flag] = 0
        self._options, self._perturbation = mujoco.MjvOption(), mujoco.MjvPerturb()
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FREE
        self._picture = np.zeros((height, width, 3), np.uint8)

    def _remember(self) -> None:
        """Keep the place of each of the helicopter's geoms in the body's frame; rotors' about their own axis."""
        model, data = self._model, self._data
        fuselage = model.body("fuselage").id
        self._own = np.flatnonzero(model.body_rootid[model.geom_bodyid] == model.body_rootid[fuselage])
        R, origin = data.xmat[fuselage].reshape(3, 3), data.xpos[fuselage]
        self._places = (data.geom_xpos[self._own] - origin) @ R
        self._turns = R.T @ data.geom_xmat[self._own].reshape(-1, 3, 3)
        names = [model.body(int(model.geom_bodyid[i])).name for i in self._own]
        self._spin = np.array([ROTORS.get(name, 0.0) for name in names])
        axes = [data.xpos[model.geom_bodyid[i]] for i in self._own]
        self._hubs = (np.array(axes) - origin) @ R

    def draw(
        self,
        pose: Pose,
        camera: Camera,
        lines: Sequence[Line] = (),
        balls: Sequence[Ball] = (),
        others: Sequence[Pose] = (),
    ) -> NDArray[np.uint8]:
        """Draw one picture, (height, width, 3), of a helicopter, and of others that look like it."""
        mujoco = engine()
        self._place(pose)
        seen = self._camera
        seen.lookat[:], seen.distance = camera.target, camera.distance
        seen.azimuth, seen.elevation = camera.azimuth, camera.elevation
        # A software renderer takes a seventh of its time for the sky, seen or not.
        above_horizon = camera.elevation + 0.5 * FIELD_OF_VIEW_DEG > -1.0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = above_horizon
        category = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, self._data, self._options, None, seen, category, self._scene)
        for other in others:
            self._place(other)
            moving = mujoco.mjtCatBit.mjCAT_DYNAMIC.value
            mujoco.mjv_addGeoms(self._model, self._data, self._options, self._perturbation, moving, self._scene)
        for line in lines:
            self._line(mujoco, line)
        for ball in balls:
            self._ball(mujoco, ball)
        rect = mujoco.MjrRect(0, 0, *self._size)
        self._gl.make_current()
        mujoco.mjr_render(rect, self._scene, self._context)
        mujoco.mjr_readPixels(self._picture, None, rect, self._context)
        return self._picture[::-1]

    def _place(self, pose: Pose) -> None:
        R = rotated_to_world(pose.quat_wxyz / np.linalg.norm(pose.quat_wxyz), np.eye(3)).T
        angle = self._spin * pose.rotor_angle
        c, s, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
        spin = np.moveaxis(np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1]]), 2, 0)
        places = self._hubs + np.einsum("nij,nj->ni", spin, self._places - self._hubs)
        self._data.geom_xpos[self._own] = pose.position + places @ R.T
        self._data.geom_xmat[self._own] = (R @ spin @ self._turns).reshape(-1, 9)

    def _line(self, mujoco: Any, line: Line) -> None:
        kind, scene = mujoco.mjtGeom.mjGEOM_LINE, self._scene
        points, rgba = np.ascontiguousarray(line.points, float), np.array(line.rgba, np.float32)
        for a, b in pairwise(points):
            if scene.ngeom >= scene.maxgeom:
                return
            geom = scene.geoms[scene.ngeom]
            mujoco.mjv_initGeom(geom, kind, _ZERO, _ZERO, _IDENTITY, rgba)
            mujoco.mjv_connector(geom, kind, line.width, a, b)
            # Lines have no shade of their own.
            geom.emission = 1.0
            scene.ngeom += 1

    def _ball(self, mujoco: Any, ball: Ball) -> None:
        scene = self._scene
        if scene.ngeom < scene.maxgeom:
            size = np.full(3, ball.radius)
            mujoco.mjv_initGeom(
                scene.geoms[scene.ngeom],
                mujoco.mjtGeom.mjGEOM_SPHERE,
                size,
                np.asarray(ball.centre, float),
                _IDENTITY,
                np.array(ball.rgba, np.float32),
            )
            scene.ngeom += 1

    def close(self) -> None:
        """Give the graphics driver back."""
        if self._context is not None:
            self._gl.make_current()
            self._context.free()
            self._context = None
        self._gl.free()

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


_ZERO, _IDENTITY = np.zeros(3), np.eye(3).ravel()


def _drawn(plant: Any) -> Any:
    """The model of a plant with what is only looked at, over a floor of squares, as an MjSpec."""
    mujoco = engine()
    spec: Any = None
    if isinstance(plant, Airframe) and plant.model:
        try:
            spec = plant.drawn()
        except ValueError:
            # Of a log whose model does not fly here.
            spec = None
    spec = spec or edited(MuJoCo(), visuals=True)
    for light in list(spec.lights):
        spec.delete(light)
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=(0, 0, 4),
        dir=(0.35, -0.3, -1),
        diffuse=(0.75, 0.73, 0.70),
        specular=(0.3, 0.3, 0.3),
        castshadow=False,
    )
    spec.visual.headlight.ambient = (0.40, 0.40, 0.42)
    spec.visual.headlight.diffuse = (0.30, 0.30, 0.30)
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 60
    spec.visual.global_.fovy, spec.stat.extent = FIELD_OF_VIEW_DEG, 1.0
    for texture in [t for t in spec.textures if t.type == mujoco.mjtTexture.mjTEXTURE_SKYBOX]:
        spec.delete(texture)
    spec.add_texture(
        name="sky above",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=ZENITH,
        rgb2=HORIZON,
        width=64,
        height=384,
    )
    spec.add_texture(
        name="squares",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=FLOOR_LIGHT,
        rgb2=FLOOR_DARK,
        width=256,
        height=256,
    )
    squares = spec.add_material(name="squares", texrepeat=(0.5 / SQUARE_M, 0.5 / SQUARE_M), texuniform=True)
    squares.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "squares"
    spec.geom("floor").material = "squares"
    # As far as can be seen.
    spec.geom("floor").size = (0, 0, 0.1)
    return spec


def _engine() -> Any:
    """The engine, whose import loads the graphics library that `MUJOCO_GL` names.

    Raises:
        HeliTwinError: It is not there.
    """
    try:
        return engine()
    except Exception as error:
        if "MUJOCO_GL" not in os.environ:
            raise
        raise HeliTwinError(NO_GRAPHICS.format(why=f"MUJOCO_GL={os.environ['MUJOCO_GL'][:20]}: {error}"[:80])) from None


def _graphics(width: int, height: int) -> Any:
    """A graphics context without a window, of the driver that `MUJOCO_GL` names; on Linux EGL by default."""
    wanted = os.environ.get("MUJOCO_GL", "").lower().strip()
    if wanted not in DRIVERS:
        # The command line has the engine loaded without any.
        wanted = {"linux": "egl", "darwin": "cgl"}.get(sys.platform, "glfw")
    try:
        return import_module(f"mujoco.{wanted}").GLContext(width, height)
    except Exception as error:
        why = " ".join(str(error).split())[:80] or type(error).__name__
        raise HeliTwinError(NO_GRAPHICS.format(why=why)) from None
