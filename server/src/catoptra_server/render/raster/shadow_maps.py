"""Shadow maps on the device: depths as the lights see them, of what stands and of what moves.

What stands is drawn once; bodies for every exposure, into maps that are fitted around them. A
depth is that of one ray, through the middle of a texel; elsewhere in it the same surface may be
nearer, by its slope times half a texel in both directions, and would hide itself. So every caster
is drawn behind itself by its slope times SLOPE texels: it casts no shadow on what is less than
that behind it, measured across the caster's plane at most SLOPE texels, however low the light.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.raster.programs import (
    Definitions,
    Programs,
    ProgramSpec,
    set_sampler,
    set_uniform,
)
from catoptra_server.render.raster.shadow_frames import (
    MOST_TEXELS,
    SIDE_TEXELS,
    Casters,
    ShadowFrame,
    frames,
)
from catoptra_server.render.shading import HideableLight
from catoptra_server.scene.bodies import Body
from catoptra_server.scene.description import DirectionalLight, PointLight
from catoptra_server.scene.meshes import SceneMesh

# OpenGL takes the greater of the two slopes, so one texel covers half a texel in both; the rest is
# for corners, which it rounds to a 256th of a texel.
SLOPE = 1.25
# Steps of the depth buffer beside that.
_STEPS = 4.0
# Two matrices a light with a direction and a dozen numbers a lamp, in the 1024 components that
# OpenGL 3.3 promises.
MAX_SUNS = 8
MAX_LAMPS = 40
# Bodies are small: half as many texels a side are finer still.
_BODIES_SHARE = 2
_SCENE_UNIT, _BODY_UNIT = 1, 2


class ShadowMaps:
    """The maps of one world's lights. `origin`: (3,), of the scene's frame in the world."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        scene: SceneMesh,
        lights: tuple[HideableLight, ...],
        *,
        origin: Floats,
    ) -> None:
        self._context = context
        self._lights = lights
        self._origin = origin
        self._suns = [light for light in lights if isinstance(light, DirectionalLight)]
        self._lamps = [light for light in lights if isinstance(light, PointLight)]
        _check_count(len(self._suns), len(self._lamps))
        self._lamp_places = tuple(np.asarray(lamp.position_m) - origin for lamp in self._lamps)
        self._cells = len(self._suns) + 6 * len(self._lamps)
        self._columns = math.ceil(math.sqrt(self._cells))
        self._side = self._side_texels()
        self._program = programs.get(ProgramSpec("shadow", "shadow"))
        self._scene_maps = self._maps(self._side)
        self._scene_frames = self._draw_scene(scene)
        self._body_maps: moderngl.Texture | None = None
        self._body_frames: tuple[ShadowFrame, ...] = ()

    @property
    def define(self) -> Definitions:
        """Return what programs define that look into the maps."""
        counts = (("SUNS", len(self._suns)), ("LAMPS", len(self._lamps)))
        named = tuple((name, count) for name, count in counts if count)
        return (("SHADOWS", 1), ("MAP_COLUMNS", self._columns), *named)

    @property
    def bytes_held(self) -> int:
        """Return the size of the maps at 4 bytes a texel; those of bodies once any was seen."""
        held = (self._scene_maps, *((self._body_maps,) if self._body_maps is not None else ()))
        return sum(4 * maps.width * maps.height for maps in held)

    def _side_texels(self) -> int:
        most = min(MOST_TEXELS, int(self._context.info["GL_MAX_TEXTURE_SIZE"]) ** 2)
        fitting = int(math.sqrt(most)) // self._columns
        return min(SIDE_TEXELS, 1 << (fitting.bit_length() - 1))

    def _maps(self, side: int) -> moderngl.Texture:
        rows = -(-self._cells // self._columns)
        maps = self._context.depth_texture((side * self._columns, side * rows))
        maps.filter = (moderngl.NEAREST, moderngl.NEAREST)
        maps.compare_func = ""  # depths are compared in the shader
        return maps

    def _draw_scene(self, scene: SceneMesh) -> tuple[ShadowFrame, ...]:
        casting = scene.casts_shadows
        corners = scene.corners[casting] - self._origin
        if not len(corners):
            corners, casting = np.zeros((1, 3, 3)), np.zeros(0, dtype=np.intp)
        normals = scene.normals[casting] if len(casting) else np.zeros((1, 3))
        casters = Casters.of_triangles(corners, normals, lamps=self._lamp_places)
        fitted = self._frames(casters, self._side)
        self._draw(self._scene_maps, fitted, corners)
        return fitted

    def _frames(self, casters: Casters, side: int) -> tuple[ShadowFrame, ...]:
        return frames(self._lights, casters, origin=self._origin, side=side)

    def draw_bodies(self, bodies: tuple[Body, ...]) -> None:
        """Draw the maps of what moves, if anything does."""
        self._body_frames = ()
        if not bodies:
            return
        side = self._side // _BODIES_SHARE
        if self._body_maps is None:
            self._body_maps = self._maps(side)
        casters = Casters.of_bodies(bodies, origin=self._origin, lamps=self._lamp_places)
        self._body_frames = self._frames(casters, side)
        corners = [body.world_from_body.points(body.mesh.corners) for body in bodies]
        self._draw(self._body_maps, self._body_frames, np.concatenate(corners) - self._origin)

    def _draw(
        self, maps: moderngl.Texture, fitted: tuple[ShadowFrame, ...], corners: Floats
    ) -> None:
        """Draw (n, 3, 3) triangles as each light sees them."""
        context = self._context
        buffer = context.buffer(corners.astype(np.float32).tobytes())
        vertices = context.vertex_array(self._program, [(buffer, "3f", "position")])
        target = context.framebuffer(depth_attachment=maps)
        side = maps.width // self._columns
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = "<"
        target.viewport = (0, 0, maps.width, maps.height)
        target.clear(depth=1.0)
        target.use()
        context.polygon_offset = SLOPE, _STEPS
        for cell, frame in enumerate(fitted):
            row, column = divmod(cell, self._columns)
            context.viewport = (side * column, side * row, side, side)
            set_uniform(self._program, "clip_from_scene", frame.clip_from_scene.T)
            vertices.render()
        context.polygon_offset = 0.0, 0.0
        for resource in (vertices, buffer, target):
            resource.release()

    def set_on(self, program: moderngl.Program, viewpoint: Floats) -> None:
        """Tell a program the lights and their maps, from a (3,) viewpoint in the scene's frame."""
        moving = self._body_frames or self._scene_frames
        set_sampler(program, "scene_maps", _SCENE_UNIT)
        set_sampler(program, "body_maps", _BODY_UNIT)
        has_bodies = program["has_bodies"]
        assert isinstance(has_bodies, moderngl.Uniform)
        has_bodies.value = bool(self._body_frames)
        count = len(self._suns)
        if count:
            towards = [-np.asarray(sun.direction) for sun in self._suns]
            set_uniform(program, "sun_towards", towards)
            set_uniform(program, "sun_irradiance", [sun.irradiance for sun in self._suns])
            for name, fitted in (("scene", self._scene_frames), ("body", moving)):
                maps = [frame.map_from_place(viewpoint).T for frame in fitted[:count]]
                set_uniform(program, f"sun_{name}_map", maps)
        if self._lamps:
            set_uniform(program, "lamp_place", np.array(self._lamp_places) - viewpoint)
            set_uniform(program, "lamp_intensity", [lamp.intensity for lamp in self._lamps])
            pairs = zip(self._scene_frames[count::6], moving[count::6], strict=True)
            set_uniform(program, "lamp_depth", [(*one.depth, *two.depth) for one, two in pairs])

    def use(self) -> None:
        """Bind the maps."""
        self._scene_maps.use(_SCENE_UNIT)
        (self._body_maps or self._scene_maps).use(_BODY_UNIT)

    def close(self) -> None:
        """Free the maps."""
        self._scene_maps.release()
        if self._body_maps is not None:
            self._body_maps.release()


def _check_count(suns: int, lamps: int) -> None:
    """Raise DomainError where a program's uniforms do not hold so many lights."""
    if suns > MAX_SUNS or lamps > MAX_LAMPS:
        raise DomainError(
            f"raster casts shadows of at most {MAX_SUNS} directional and {MAX_LAMPS} point lights, "
            f"not of {suns} and {lamps}: draw with the trace renderer, or set Shadows=never"
        )
