"""A static scene on the device: uploaded once, drawn for any face.

Triangles are grouped by texture and cut into clusters. Positions are relative to the scene's
centre, for the passes that use one float32 number of each. Shadows use a second set of attributes
and shadow maps; neither exists before the first camera state with shadows. Facets then carry the
light of hemisphere lights alone, and each fragment adds the unshadowed part of the other lights.
"""

from __future__ import annotations

from typing import Protocol

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.projection.frustum import DepthRangeFinder
from catoptra_server.render.raster.device import (
    COARSE_FORMAT,
    FrameUniforms,
    SampleSpacing,
    ShaderPrograms,
    set_fog,
    split_positions,
)
from catoptra_server.render.raster.scene_batches import (
    DynamicObjectBuffer,
    FacetLighting,
    SceneBatches,
    upload_values,
)
from catoptra_server.render.raster.shadow_maps import ShadowMaps
from catoptra_server.world import shading
from catoptra_server.world.camera_state import CameraState, FogMedium
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.triangles import TriangleClusters, make_clusters
from catoptra_server.world.world_description import Light, World

# Two vec3 a light, each as large as a vec4, in the 1024 uniform components that OpenGL 3.3
# guarantees; the rest is for matrices.
_MAX_POINT_LIGHTS = 100


class LitScene(Protocol):
    """A scene and its dynamic objects under the lighting of a camera state."""

    dynamic_objects: DynamicObjectBuffer

    def set_frame(self, viewpoint: Floats, depth_from_forward: tuple[float, float]) -> None:
        """Write the uniforms of a frame.

        Args:
            viewpoint: (3,) position in the scene's frame, metres.
            depth_from_forward: (a, b) of clip z = a w + b.
        """

    def set_fog(self, fog: FogMedium | None) -> None:
        """Write the fog of a frame; None for clear air."""

    def set_spacing(self, spacing: SampleSpacing | None, axis: Floats) -> None:
        """Choose the levels of textures for samples around a (3,) axis; None for fragments'."""

    def draw(self, clip_from_scene: Floats, visible: Bools) -> int:
        """Draw the visible clusters through a (3, 3) map to clip x, y, w; return the draw calls."""


class SceneBuffers:
    """Vertex buffers, textures and programs of one world."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        scene: SceneMesh,
        world: World,
        *,
        scene_lights: tuple[Light, ...] | None = None,
    ) -> None:
        """Upload a scene.

        Args:
            context: OpenGL context.
            programs: Shader programs of the context.
            scene: Triangles of the static scene.
            world: Lights and background.
            scene_lights: Lights that change the static scene visibly; None for all of the world.

        Raises:
            DomainError: More point lights than uniforms hold.
        """
        self._context = context
        self._programs = programs
        self._scene = scene
        self._world = world
        lights = world.lights if scene_lights is None else scene_lights
        # Two lightings: objects move towards lights that are too weak for the static scene.
        lighting, object_lighting = _make_facet_lighting(lights), _make_facet_lighting(world.lights)
        self.background = world.background
        low, high = (scene.corners.min((0, 1)), scene.corners.max((0, 1))) if len(scene) else (0, 0)
        self.origin: Floats = np.zeros(3) + 0.5 * (low + high)
        self._lights = shading.point_lights(lights)
        self.dynamic_objects = DynamicObjectBuffer(context, programs, object_lighting, self.origin)
        corners = scene.corners - self.origin
        # Grouped by texture first: a batch's clusters are consecutive, and group 0 has no texture.
        self.clusters = make_clusters(corners, (scene.texture_index + 1).astype(np.intp))
        self.cluster_sizes = np.diff(self.clusters.offsets)
        self.depth_range_finder = DepthRangeFinder(self.clusters, corners)
        self._position = upload_values(context, split_positions(corners[self.clusters.order]))
        self._batches = SceneBatches(
            context, programs, scene, self.clusters, position=self._position, lighting=lighting
        )
        self._shadowed: _ShadowedScene | None = None

    def make_position_array(self, program: moderngl.Program) -> moderngl.VertexArray:
        """Vertex array of all corners, cluster by cluster, without other attributes.

        The caller frees the array, not the buffer.
        """
        return self._context.vertex_array(program, [(self._position, COARSE_FORMAT, "position")])

    def with_lighting(self, camera_state: CameraState) -> LitScene:
        """Scene under the lighting of a camera state: with shadows where some light casts any."""
        if not camera_state.has_shadows or not shading.shadow_casting_lights(self._world.lights):
            return self
        # Built at the first frame with shadows: maps of up to 128 MiB that most worlds never need.
        if self._shadowed is None:
            self._shadowed = _ShadowedScene(
                self._context,
                self._programs,
                self._scene,
                self._world.lights,
                clusters=self.clusters,
                position=self._position,
                origin=self.origin,
            )
        self._shadowed.draw_object_shadows(camera_state.objects)
        return self._shadowed

    def set_frame(self, viewpoint: Floats, depth_from_forward: tuple[float, float]) -> None:
        """Write the uniforms of a frame.

        Args:
            viewpoint: (3,) position in the scene's frame, metres.
            depth_from_forward: (a, b) of clip z = a w + b.
        """
        frame = FrameUniforms.from_viewpoint(
            viewpoint, depth_from_forward, lights=self._lights, origin=self.origin
        )
        for program in self._batches.programs:
            frame.apply_to(program)
        # Objects receive the culled lights too, so their program may have more lights than the
        # scene's.
        lights = shading.point_lights(self._world.lights)
        self.dynamic_objects.set_frame(
            FrameUniforms.from_viewpoint(
                viewpoint, depth_from_forward, lights=lights, origin=self.origin
            )
        )

    def set_fog(self, fog: FogMedium | None) -> None:
        """Write the fog of a frame; None for clear air."""
        for program in self._batches.programs | self.dynamic_objects.programs:
            set_fog(program, fog)

    def set_spacing(self, spacing: SampleSpacing | None, axis: Floats) -> None:
        """Choose the levels of textures for samples around a (3,) axis; None for fragments'."""
        self._batches.set_spacing(spacing, axis)

    def draw(self, clip_from_scene: Floats, visible: Bools) -> int:
        """Draw the visible clusters through a (3, 3) map to clip x, y, w; return the draw calls."""
        return self._batches.draw(clip_from_scene, visible)

    def close(self) -> None:
        """Free the buffers, vertex arrays and textures; programs belong to the context."""
        self.dynamic_objects.close()
        if self._shadowed is not None:
            self._shadowed.close()
        self._batches.close()
        self._position.release()


def _make_facet_lighting(lights: tuple[Light, ...]) -> FacetLighting:
    """Lighting of facets without shadows."""
    count = len(shading.point_lights(lights))
    if count > _MAX_POINT_LIGHTS:
        raise DomainError(f"raster draws at most {_MAX_POINT_LIGHTS} point lights, not {count}")
    return FacetLighting(lights, (("NUM_POINT_LIGHTS", count),) if count else ())


class _ShadowedScene:
    """Attributes, dynamic objects and shadow maps of a world with shadows."""

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        scene: SceneMesh,
        lights: tuple[Light, ...],
        *,
        clusters: TriangleClusters,
        position: moderngl.Buffer,
        origin: Floats,
    ) -> None:
        """Upload attributes and draw the static shadow maps; arguments as of SceneBuffers."""
        self._origin = origin
        self._maps = ShadowMaps(
            context, programs, scene, shading.shadow_casting_lights(lights), origin=origin
        )
        light = FacetLighting(shading.hemisphere_lights(lights), self._maps.definitions)
        self.dynamic_objects = DynamicObjectBuffer(context, programs, light, origin)
        self._batches = SceneBatches(
            context, programs, scene, clusters, position=position, lighting=light
        )

    def draw_object_shadows(self, objects: tuple[DynamicObject, ...]) -> None:
        """Draw the shadow maps of a frame's dynamic objects; the static scene's were drawn once."""
        self._maps.draw_objects(objects)

    def set_frame(self, viewpoint: Floats, depth_from_forward: tuple[float, float]) -> None:
        """Write the uniforms of a frame.

        Args:
            viewpoint: (3,) position in the scene's frame, metres.
            depth_from_forward: (a, b) of clip z = a w + b.
        """
        # Without point lights: the shadowed program has the shadow maps' uniforms
        # instead.
        frame = FrameUniforms.from_viewpoint(
            viewpoint, depth_from_forward, lights=(), origin=self._origin
        )
        for program in self._batches.programs | self.dynamic_objects.programs:
            frame.apply_to(program)
            self._maps.apply_to(program, viewpoint)
        self._maps.bind()

    def set_fog(self, fog: FogMedium | None) -> None:
        """Write the fog of a frame; None for clear air."""
        for program in self._batches.programs | self.dynamic_objects.programs:
            set_fog(program, fog)

    def set_spacing(self, spacing: SampleSpacing | None, axis: Floats) -> None:
        """Choose the levels of textures for samples around a (3,) axis; None for fragments'."""
        self._batches.set_spacing(spacing, axis)

    def draw(self, clip_from_scene: Floats, visible: Bools) -> int:
        """Draw the visible clusters through a (3, 3) map to clip x, y, w; return the draw calls."""
        return self._batches.draw(clip_from_scene, visible)

    def close(self) -> None:
        """Free all resources but the corners, which belong to the scene."""
        self.dynamic_objects.close()
        self._batches.close()
        self._maps.close()
