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
from catoptra_server.render.raster.shader_programs import (
    Definitions,
    ProgramSpec,
    ShaderPrograms,
    set_sampler,
    set_uniform,
)
from catoptra_server.render.projection.shadow_projections import (
    MAX_SIDE_TEXELS,
    MAX_TOTAL_TEXELS,
    ShadowCasters,
    ShadowProjection,
    fit_shadow_projections,
)
from catoptra_server.scene.dynamic_object import DynamicObject
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.shading import ShadowCastingLight
from catoptra_server.scene.world_description import DirectionalLight, PointLight

# OpenGL takes the greater of the two slopes, so one texel covers half a texel in both; the rest is
# for corners, which it rounds to a 256th of a texel.
SLOPE_BIAS_TEXELS = 1.25
# Steps of the depth buffer beside that.
_CONSTANT_BIAS_STEPS = 4.0
# Two matrices a light with a direction and a dozen numbers a lamp, in the 1024 components that
# OpenGL 3.3 promises.
MAX_SHADOWED_DIRECTIONAL_LIGHTS = 8
MAX_SHADOWED_POINT_LIGHTS = 40
# Bodies are small: half as many texels a side are finer still.
_OBJECT_MAP_DIVISOR = 2
_SCENE_UNIT, _OBJECT_UNIT = 1, 2


class ShadowMaps:
    """The maps of one world's lights. `origin`: (3,), of the scene's frame in the world."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        scene: SceneMesh,
        lights: tuple[ShadowCastingLight, ...],
        *,
        origin: Floats,
    ) -> None:
        self._context = context
        self._lights = lights
        self._origin = origin
        self._directional_lights = [
            light for light in lights if isinstance(light, DirectionalLight)
        ]
        self._point_lights = [light for light in lights if isinstance(light, PointLight)]
        _check_light_counts(len(self._directional_lights), len(self._point_lights))
        self._point_light_positions = tuple(
            np.asarray(lamp.position_m) - origin for lamp in self._point_lights
        )
        self._cells = len(self._directional_lights) + 6 * len(self._point_lights)
        self._columns = math.ceil(math.sqrt(self._cells))
        self._side = self._max_side_texels()
        self._program = programs.get(ProgramSpec("shadow", "shadow"))
        self._scene_maps = self._make_texture(self._side)
        self._scene_projections = self._draw_scene(scene)
        self._object_maps: moderngl.Texture | None = None
        self._object_projections: tuple[ShadowProjection, ...] = ()

    @property
    def definitions(self) -> Definitions:
        """Return what programs define that look into the maps."""
        counts = (("NUM_SHADOWED_DIRECTIONAL_LIGHTS", len(self._directional_lights)), ("NUM_SHADOWED_POINT_LIGHTS", len(self._point_lights)))
        named = tuple((name, count) for name, count in counts if count)
        return (("SHADOWS", 1), ("MAP_COLUMNS", self._columns), *named)

    @property
    def texture_bytes(self) -> int:
        """Return the size of the maps at 4 bytes a texel; those of bodies once any was seen."""
        held = (self._scene_maps, *((self._object_maps,) if self._object_maps is not None else ()))
        return sum(4 * maps.width * maps.height for maps in held)

    def _max_side_texels(self) -> int:
        most = min(MAX_TOTAL_TEXELS, int(self._context.info["GL_MAX_TEXTURE_SIZE"]) ** 2)
        fitting = int(math.sqrt(most)) // self._columns
        return min(MAX_SIDE_TEXELS, 1 << (fitting.bit_length() - 1))

    def _make_texture(self, side: int) -> moderngl.Texture:
        rows = -(-self._cells // self._columns)
        maps = self._context.depth_texture((side * self._columns, side * rows))
        maps.filter = (moderngl.NEAREST, moderngl.NEAREST)
        maps.compare_func = ""  # depths are compared in the shader
        return maps

    def _draw_scene(self, scene: SceneMesh) -> tuple[ShadowProjection, ...]:
        casting = scene.casts_shadows
        corners = scene.corners[casting] - self._origin
        if not len(corners):
            corners, casting = np.zeros((1, 3, 3)), np.zeros(0, dtype=np.intp)
        normals = scene.normals[casting] if len(casting) else np.zeros((1, 3))
        casters = ShadowCasters.from_triangles(
            corners, normals, light_positions=self._point_light_positions
        )
        fitted = self._fit_projections(casters, self._side)
        self._draw(self._scene_maps, fitted, corners)
        return fitted

    def _fit_projections(self, casters: ShadowCasters, side: int) -> tuple[ShadowProjection, ...]:
        return fit_shadow_projections(self._lights, casters, origin=self._origin, side_texels=side)

    def draw_objects(self, objects: tuple[DynamicObject, ...]) -> None:
        """Draw the maps of what moves, if anything does."""
        self._object_projections = ()
        if not objects:
            return
        side = self._side // _OBJECT_MAP_DIVISOR
        if self._object_maps is None:
            self._object_maps = self._make_texture(side)
        casters = ShadowCasters.from_objects(
            objects, origin=self._origin, light_positions=self._point_light_positions
        )
        self._object_projections = self._fit_projections(casters, side)
        corners = [body.world_from_object.transform_points(body.mesh.corners) for body in objects]
        self._draw(
            self._object_maps, self._object_projections, np.concatenate(corners) - self._origin
        )

    def _draw(
        self, maps: moderngl.Texture, fitted: tuple[ShadowProjection, ...], corners: Floats
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
        context.polygon_offset = SLOPE_BIAS_TEXELS, _CONSTANT_BIAS_STEPS
        for cell, frame in enumerate(fitted):
            row, column = divmod(cell, self._columns)
            context.viewport = (side * column, side * row, side, side)
            set_uniform(self._program, "clip_from_scene", frame.clip_from_scene.T)
            vertices.render()
        context.polygon_offset = 0.0, 0.0
        for resource in (vertices, buffer, target):
            resource.release()

    def apply_to(self, program: moderngl.Program, viewpoint: Floats) -> None:
        """Tell a program the lights and their maps, from a (3,) viewpoint in the scene's frame."""
        moving = self._object_projections or self._scene_projections
        set_sampler(program, "scene_shadow_maps", _SCENE_UNIT)
        set_sampler(program, "object_shadow_maps", _OBJECT_UNIT)
        has_bodies = program["has_objects"]
        assert isinstance(has_bodies, moderngl.Uniform)
        has_bodies.value = bool(self._object_projections)
        count = len(self._directional_lights)
        if count:
            towards = [-np.asarray(sun.direction) for sun in self._directional_lights]
            set_uniform(program, "directional_light_to_source", towards)
            set_uniform(
                program, "directional_light_irradiance", [sun.irradiance for sun in self._directional_lights]
            )
            for name, fitted in (("scene", self._scene_projections), ("objects", moving)):
                maps = [frame.map_from_offset(viewpoint).T for frame in fitted[:count]]
                set_uniform(program, f"map_from_offset_{name}", maps)
        if self._point_lights:
            set_uniform(program, "point_light_positions", np.array(self._point_light_positions) - viewpoint)
            set_uniform(program, "point_light_intensities", [lamp.intensity for lamp in self._point_lights])
            pairs = zip(self._scene_projections[count::6], moving[count::6], strict=True)
            set_uniform(
                program,
                "point_light_depth_from_forward",
                [(*one.depth_from_forward, *two.depth_from_forward) for one, two in pairs],
            )

    def bind(self) -> None:
        """Bind the maps."""
        self._scene_maps.use(_SCENE_UNIT)
        (self._object_maps or self._scene_maps).use(_OBJECT_UNIT)

    def close(self) -> None:
        """Free the maps."""
        self._scene_maps.release()
        if self._object_maps is not None:
            self._object_maps.release()


def _check_light_counts(num_directional: int, num_point: int) -> None:
    """Raise DomainError where a program's uniforms do not hold so many lights."""
    if num_directional > MAX_SHADOWED_DIRECTIONAL_LIGHTS or num_point > MAX_SHADOWED_POINT_LIGHTS:
        raise DomainError(
            f"raster casts shadows of at most {MAX_SHADOWED_DIRECTIONAL_LIGHTS} directional and {MAX_SHADOWED_POINT_LIGHTS} point lights, "
            f"not of {num_directional} and {num_point}: draw with the trace renderer, or set Shadows=never"
        )
