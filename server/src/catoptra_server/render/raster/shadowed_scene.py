"""A scene on the device whose lights cast shadows: a second set of attributes, and shadow maps.

Facets carry the light of hemisphere lights alone; each fragment adds the unshadowed part of the
other lights.
"""

from __future__ import annotations

import moderngl

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.raster.dynamic_object_buffer import DynamicObjectBuffer
from catoptra_server.render.raster.fog_uniform import set_fog
from catoptra_server.render.raster.frame_uniforms import FrameUniforms
from catoptra_server.render.raster.sample_spacing import SampleSpacing
from catoptra_server.render.raster.scene_batches import FacetLighting, SceneBatches
from catoptra_server.render.raster.shader_programs import ShaderPrograms
from catoptra_server.render.raster.shadow_maps import ShadowMaps
from catoptra_server.world import shading
from catoptra_server.world.camera_state import FogMedium
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.triangles import TriangleClusters
from catoptra_server.world.world_description import Light


class ShadowedScene:
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
        # Without point lights: the shadowed program takes them from the shadow maps' uniforms
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
