"""Ranges of all pixels on the device: the faces once more, with ranges in an atlas of their own.

Near defocus needs the range of a pixel; the pass exists only where a running effect uses ranges.
Fog needs none: the fragments of faces know theirs. One sample a texel, looked up without
interpolation: a range between two surfaces would belong to neither. At a silhouette a pixel may
therefore have the range of a surface half a texel away.
"""

from __future__ import annotations

import math

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.render.projection.atlas import Atlas, AtlasCell
from catoptra_server.render.projection.frustum import LensProjection
from catoptra_server.render.raster.device import (
    FrameUniforms,
    ProgramSpec,
    ShaderPrograms,
    make_depth_buffer,
    set_sampler,
    set_uniform,
)
from catoptra_server.render.raster.face_pass import frustum_planes
from catoptra_server.render.raster.passes import image_bytes
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.world.objects import CameraState


class RangePass:
    """From the scene to the texture of each pixel's range."""

    name = "ranges"

    def __init__(
        self,
        context: moderngl.Context,
        programs: ShaderPrograms,
        scene: SceneBuffers,
        atlas: Atlas | LensProjection,
        camera: RadialCamera,
        lookup_map: moderngl.Texture,
    ) -> None:
        """Create the atlas of ranges and the texture of pixel ranges.

        Args:
            context: OpenGL context.
            programs: Shader programs of the context.
            scene: Scene on the device.
            atlas: Layout of the view's faces, or the projection of its only one.
            camera: Camera model of the image.
            lookup_map: Atlas coordinates of pixel centres, freed with this pass.
        """
        self._context = context
        self._scene = scene
        self._atlas = atlas
        self._lookup_map = lookup_map
        self._clip_from_mirror = np.stack([cell.clip_from_mirror for cell in atlas.cells])
        size = (atlas.width, atlas.height)
        self._texels = _make_texture(context, size)
        # A depth buffer of its own: the faces' may be multisampled, ranges are not.
        self._depth = make_depth_buffer(context, size)
        self._target = context.framebuffer([self._texels], self._depth)
        self._ranges = _make_texture(context, (camera.width_px, camera.height_px))
        self._range_target = context.framebuffer([self._ranges])
        self._surface_program = programs.get(ProgramSpec("face", "range"))
        self._vertices = scene.make_position_array(self._surface_program)
        self._lookup_program = programs.get(ProgramSpec("fullscreen_triangle", "pixel_range"))
        self._fullscreen_triangle = context.vertex_array(self._lookup_program, [])

    @property
    def memory_bytes(self) -> int:
        """Size of the atlas of ranges, of the lookup map and of the result."""
        return image_bytes(self._texels, self._depth, self._lookup_map, self._ranges)

    def draw(self, camera_state: CameraState) -> None:
        """Fill the texture for a camera state."""
        self._draw_faces(camera_state)
        self._context.enable_only(moderngl.NOTHING)
        self._range_target.use()
        # Two steps as for the image: ranges of faces, then the texel at each pixel's centre.
        set_sampler(self._lookup_program, "lookup_map", 1)
        self._texels.use(0)
        self._lookup_map.use(1)
        self._fullscreen_triangle.render(vertices=3)

    def _draw_faces(self, camera_state: CameraState) -> None:
        """Render the range of every texel of the atlas."""
        pose = camera_state.world_from_mirror
        viewpoint = pose.translation - self._scene.origin
        uniforms = FrameUniforms.from_viewpoint(viewpoint, lights=(), origin=self._scene.origin)
        batches = self._scene.plain.batches
        holed = batches.range_batches if self._scene.has_filter else []
        for program in {self._surface_program, *(batch.program for batch in holed)}:
            uniforms.apply_to(program)
        pieces = self._scene.split_large_triangles(viewpoint)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = ">"
        self._target.viewport = (0, 0, self._atlas.width, self._atlas.height)
        # Infinity where no surface is: fog and defocus treat the background as infinitely far.
        self._target.clear(math.inf, depth=0.0)
        self._target.use()
        objects = self._scene.plain.dynamic_objects
        objects.upload(camera_state.objects, pose.translation)
        clip_from_scene = self._clip_from_mirror @ pose.rotation.T
        # The scene's clusters are culled by face; objects are few and drawn into every face.
        clusters = self._scene.clusters
        visible = clusters.in_front_of_planes(frustum_planes(clip_from_scene), viewpoint)
        cells: tuple[AtlasCell | LensProjection, ...] = self._atlas.cells
        for cell, clip, visible_clusters in zip(cells, clip_from_scene, visible, strict=True):
            self._context.viewport = cell.viewport
            set_uniform(self._surface_program, "clip_from_scene", clip.T)
            runs = pieces.runs(visible_clusters, clusters.offsets, len(clusters.order))
            if holed:
                runs = []
                batches.draw(clip, visible_clusters, pieces, holed)
            for first, count in runs:
                self._vertices.render(vertices=3 * count, first=3 * first)
            objects.draw_positions(self._surface_program)

    def read(self) -> npt.NDArray[np.float32]:
        """Read the (h, w) ranges of the last frame back, metres."""
        width, height = self._ranges.size
        data = self._range_target.read(components=1, dtype="f4", alignment=1)
        return np.frombuffer(data, dtype=np.float32).reshape(height, width)

    def close(self) -> None:
        """Free the pass's resources; the vertex buffer belongs to the scene."""
        for resource in (
            self._vertices,
            self._fullscreen_triangle,
            self._target,
            self._range_target,
            self._texels,
            self._depth,
            self._ranges,
            self._lookup_map,
        ):
            resource.release()


def _make_texture(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Texture:
    """Texture of one float32 channel without interpolation."""
    # Half floats would round a range of 10 m to 8 mm.
    texture = context.texture(size, 1, dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture
