"""Shadow maps on the device: depths from each light, of the static scene and of dynamic objects.

The static scene is drawn once; objects in every frame, into maps fitted around them. A texel holds
the depth of one ray, through the texel's centre; elsewhere in the texel the same surface may be
nearer, by its slope times half a texel in both directions, and would shadow itself. Every caster is
therefore pushed back by its slope times SLOPE_BIAS_TEXELS: no shadow falls on a surface closer
behind than that, measured across the caster's plane at most SLOPE_BIAS_TEXELS texels, however low
the light. A map is read with a single tap: nearly everywhere a texel is smaller than a pixel. A
frame with shadows takes 2.8 times as long as one without.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.projection.shadow_projections import (
    MAX_SIDE_TEXELS,
    MAX_TOTAL_TEXELS,
    ShadowCasters,
    ShadowProjection,
    fit_shadow_projections,
)
from catoptra_server.render.raster.device import (
    Definitions,
    ProgramSpec,
    ShaderPrograms,
    set_sampler,
    set_uniform,
)
from catoptra_server.render.raster.scene_batches import (
    FILTERED,
    ImageTexture,
    upload_texture,
    upload_values,
)
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import ShadowCastingLight
from catoptra_server.world.world_description import DirectionalLight, PointLight

# OpenGL uses the greater of the two slopes, so one texel covers half a texel in both directions;
# the rest is for corners, which OpenGL rounds to a 256th of a texel.
SLOPE_BIAS_TEXELS = 1.25
# Further bias in steps of the depth buffer, for the rounding of depths.
_CONSTANT_BIAS_STEPS = 4.0
# Two matrices per directional light and a dozen numbers per point light, in the 1024 uniform
# components that OpenGL 3.3 guarantees.
_MAX_DIRECTIONAL_LIGHTS = 8
_MAX_POINT_LIGHTS = 40
# Dynamic objects are small: with half as many texels a side their maps are finer still.
_OBJECT_MAP_DIVISOR = 2
# Texture units; unit 0 has the albedo texture of a batch.
_SCENE_UNIT, _OBJECT_UNIT = 1, 2


class ShadowMaps:
    """The shadow maps of one world's lights."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        scene: SceneMesh,
        lights: tuple[ShadowCastingLight, ...],
        *,
        origin: Floats,
        textures: Sequence[ImageTexture] = (),
    ) -> None:
        """Draw the maps of the static scene.

        Args:
            context: OpenGL context.
            programs: Shader programs of the context.
            scene: Triangles of the static scene.
            lights: Shadow-casting lights.
            origin: (3,) origin of the scene's frame in the world.
            textures: Textures of a scene with holes.

        Raises:
            DomainError: More lights than a program's uniforms hold.
        """
        self._context = context
        self._programs = programs
        self._lights = lights
        self._origin = origin
        self._directional_lights = [
            light for light in lights if isinstance(light, DirectionalLight)
        ]
        self._point_lights = [light for light in lights if isinstance(light, PointLight)]
        counts = len(self._directional_lights), len(self._point_lights)
        if counts[0] > _MAX_DIRECTIONAL_LIGHTS or counts[1] > _MAX_POINT_LIGHTS:
            raise DomainError(
                f"raster casts shadows of at most {_MAX_DIRECTIONAL_LIGHTS} directional and "
                f"{_MAX_POINT_LIGHTS} point lights, not of {counts[0]} and {counts[1]}: "
                "use the trace renderer, or set Shadows=never"
            )
        self._point_light_positions = tuple(
            np.asarray(light.position_m) - origin for light in self._point_lights
        )
        self._cells = len(self._directional_lights) + 6 * len(self._point_lights)
        self._columns = math.ceil(math.sqrt(self._cells))
        self._side = self._max_side_texels()
        self._program = programs.get(ProgramSpec("shadow", "shadow"))
        self._scene_maps = self._make_texture(self._side)
        self._scene_projections = self._draw_scene(scene, textures)
        self._object_maps: moderngl.Texture | None = None
        self._object_projections: tuple[ShadowProjection, ...] = ()

    @property
    def definitions(self) -> Definitions:
        """Preprocessor definitions of programs that sample the maps."""
        counts = (
            ("NUM_SHADOWED_DIRECTIONAL_LIGHTS", len(self._directional_lights)),
            ("NUM_SHADOWED_POINT_LIGHTS", len(self._point_lights)),
        )
        existing = tuple((name, count) for name, count in counts if count)
        return (("SHADOWS", 1), ("MAP_COLUMNS", self._columns), *existing)

    @property
    def texture_bytes(self) -> int:
        """Size of the maps at 4 bytes a texel; objects' maps count once there are any."""
        textures = (self._scene_maps, self._object_maps)
        return sum(4 * maps.width * maps.height for maps in textures if maps is not None)

    def _max_side_texels(self) -> int:
        """Side of a map: a power of two such that all maps fit into one texture."""
        max_texels = min(MAX_TOTAL_TEXELS, int(self._context.info["GL_MAX_TEXTURE_SIZE"]) ** 2)
        max_side = int(math.sqrt(max_texels)) // self._columns
        return min(MAX_SIDE_TEXELS, 1 << (max_side.bit_length() - 1))

    def _make_texture(self, side: int) -> moderngl.Texture:
        """Depth texture for the maps of all lights, in a grid of cells."""
        rows = -(-self._cells // self._columns)
        maps = self._context.depth_texture((side * self._columns, side * rows))
        maps.filter = (moderngl.NEAREST, moderngl.NEAREST)
        maps.compare_func = ""  # depths are compared in the shader
        return maps

    def _draw_scene(
        self, scene: SceneMesh, textures: Sequence[ImageTexture]
    ) -> tuple[ShadowProjection, ...]:
        """Fit and draw the maps of the static scene."""
        casting = scene.casts_shadows
        corners = scene.corners[casting] - self._origin
        # A scene without casters still needs a map to sample: one degenerate triangle covers no
        # texel.
        if not len(corners):
            corners, casting = np.zeros((1, 3, 3)), np.zeros(0, dtype=np.intp)
        normals = scene.normals[casting] if len(casting) else np.zeros((1, 3))
        casters = ShadowCasters.from_triangles(
            corners, normals, light_positions=self._point_light_positions
        )
        projections = self._fit_projections(casters, self._side)
        if scene.coverage is None or not len(casting):
            self._draw(self._scene_maps, projections, corners)
            return projections
        solid = corners[~np.isfinite(scene.coverage[casting, 0])]
        # As above, where all casters have holes.
        solid = np.concatenate((solid, np.zeros((1, 3, 3))))
        opaque = upload_texture(self._context, np.full((1, 1, 3), 255, dtype=np.uint8))
        holed = self._group_holes(scene, (opaque, *textures))
        self._draw(self._scene_maps, projections, solid, holed)
        opaque.release()
        return projections

    def _group_holes(
        self, scene: SceneMesh, textures: Sequence[ImageTexture]
    ) -> list[tuple[Floats, ImageTexture]]:
        """(k, 3, 6) positions, texture coordinates and coverage of casters with holes, by texture.

        The first of the textures is that of triangles without one.
        """
        assert scene.coverage is not None
        holed = scene.casts_shadows & np.isfinite(scene.coverage[:, 0])
        corners = scene.corners - self._origin
        values = np.concatenate((corners, scene.corner_uv, scene.coverage[..., None]), axis=-1)
        groups = [
            (holed & (scene.texture_index == number - 1), texture)
            for number, texture in enumerate(textures)
        ]
        return [(values[rows], texture) for rows, texture in groups if rows.any()]

    def _fit_projections(self, casters: ShadowCasters, side: int) -> tuple[ShadowProjection, ...]:
        """Projections of all lights around casters."""
        return fit_shadow_projections(self._lights, casters, origin=self._origin, side_texels=side)

    def draw_objects(self, objects: tuple[DynamicObject, ...]) -> None:
        """Draw the maps of dynamic objects, if there are any."""
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
        corners = [one.world_from_object.transform_points(one.mesh.corners) for one in objects]
        self._draw(
            self._object_maps, self._object_projections, np.concatenate(corners) - self._origin
        )

    def _draw(
        self,
        maps: moderngl.Texture,
        projections: tuple[ShadowProjection, ...],
        corners: Floats,
        holed: Sequence[tuple[Floats, ImageTexture]] = (),
    ) -> None:
        """Draw (n, 3, 3) triangles, and those of `_group_holes`, as each light sees them."""
        context = self._context
        buffers = [upload_values(context, values) for values in (corners, *(v for v, _ in holed))]
        solid = context.vertex_array(self._program, [(buffers[0], "3f", "position")])
        draws: list[tuple[moderngl.VertexArray, ImageTexture | None]] = [(solid, None)]
        for buffer, (_, albedo) in zip(buffers[1:], holed, strict=True):
            program = self._programs.get(ProgramSpec("shadow", "shadow", FILTERED))
            layout = (buffer, "3f 3f", "position", "uv_coverage")
            draws.append((context.vertex_array(program, [layout]), albedo))
        target = context.framebuffer(depth_attachment=maps)
        side = maps.width // self._columns
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = "<"
        target.viewport = (0, 0, maps.width, maps.height)
        # All cells at once: clearing each cell by itself takes a scissored clear per light.
        target.clear(depth=1.0)
        target.use()
        context.polygon_offset = SLOPE_BIAS_TEXELS, _CONSTANT_BIAS_STEPS
        for cell, projection in enumerate(projections):
            row, column = divmod(cell, self._columns)
            context.viewport = (side * column, side * row, side, side)
            for vertices, texture in draws:
                if texture is not None:
                    texture.use(0)
                set_uniform(vertices.program, "clip_from_scene", projection.clip_from_scene.T)
                vertices.render()
        context.polygon_offset = 0.0, 0.0
        # The static scene is drawn once, and objects change in every frame: no buffer is worth
        # keeping.
        for vertices, _ in draws:
            vertices.release()
        for buffer in buffers:
            buffer.release()
        target.release()

    def apply_to(self, program: moderngl.Program, viewpoint: Floats) -> None:
        """Write the lights and their maps to a program; viewpoint: (3,) in the scene's frame."""
        object_projections = self._object_projections or self._scene_projections
        set_sampler(program, "scene_shadow_maps", _SCENE_UNIT)
        set_sampler(program, "object_shadow_maps", _OBJECT_UNIT)
        has_objects = program["has_objects"]
        assert isinstance(has_objects, moderngl.Uniform)
        has_objects.value = bool(self._object_projections)
        if self._directional_lights:
            self._apply_directional_lights(program, object_projections, viewpoint)
        if self._point_lights:
            self._apply_point_lights(program, object_projections, viewpoint)

    def _apply_directional_lights(
        self,
        program: moderngl.Program,
        object_projections: tuple[ShadowProjection, ...],
        viewpoint: Floats,
    ) -> None:
        """Write direction, irradiance and both matrices of each directional light."""
        lights = self._directional_lights
        to_sources = [-np.asarray(light.direction) for light in lights]
        set_uniform(program, "directional_light_to_source", to_sources)
        irradiances = [light.irradiance for light in lights]
        set_uniform(program, "directional_light_irradiance", irradiances)
        both = {"scene": self._scene_projections, "objects": object_projections}
        for name, projections in both.items():
            maps = [one.map_from_offset(viewpoint).T for one in projections[: len(lights)]]
            set_uniform(program, f"map_from_offset_{name}", maps)

    def _apply_point_lights(
        self,
        program: moderngl.Program,
        object_projections: tuple[ShadowProjection, ...],
        viewpoint: Floats,
    ) -> None:
        """Write position, intensity and the depth mappings of each point light."""
        positions = np.array(self._point_light_positions) - viewpoint
        set_uniform(program, "point_light_positions", positions)
        intensities = [light.intensity for light in self._point_lights]
        set_uniform(program, "point_light_intensities", intensities)
        # The six faces of a light share one depth mapping: the first of each six will do.
        first = len(self._directional_lights)
        pairs = zip(self._scene_projections[first::6], object_projections[first::6], strict=True)
        depths = [(*scene.depth_from_forward, *other.depth_from_forward) for scene, other in pairs]
        set_uniform(program, "point_light_depth_from_forward", depths)

    def bind(self) -> None:
        """Bind the maps to their texture units."""
        self._scene_maps.use(_SCENE_UNIT)
        (self._object_maps or self._scene_maps).use(_OBJECT_UNIT)

    def close(self) -> None:
        """Free the maps."""
        self._scene_maps.release()
        if self._object_maps is not None:
            self._object_maps.release()
