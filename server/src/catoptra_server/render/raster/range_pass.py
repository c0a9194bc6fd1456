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

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.render.projection.atlas import Atlas, AtlasCell
from catoptra_server.render.projection.frustum import LensProjection
from catoptra_server.render.raster.device import (
    ProgramSpec,
    ShaderPrograms,
    set_sampler,
    set_uniform,
)
from catoptra_server.render.raster.face_pass import frame_depth_range, frustum_planes
from catoptra_server.render.raster.passes import image_bytes
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_server.world.triangles import visible_runs


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
        self._max_depth_ratio = max(cell.max_depth_ratio for cell in atlas.cells)
        size = (atlas.width, atlas.height)
        self._texels = _make_texture(context, size)
        # A depth buffer of its own: the faces' may be multisampled, ranges are not.
        self._depth = context.depth_renderbuffer(size)
        self._target = context.framebuffer([self._texels], self._depth)
        self._ranges = _make_texture(context, (camera.width_px, camera.height_px))
        self._range_target = context.framebuffer([self._ranges])
        self._surface_program = programs.get(ProgramSpec("range", "range"))
        self._vertices = scene.make_position_array(self._surface_program)
        self._objects = _ObjectPositions(context, self._surface_program, scene.origin)
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
        depth = frame_depth_range(self._scene, camera_state, self._max_depth_ratio)
        set_uniform(self._surface_program, "viewpoint", viewpoint)
        set_uniform(self._surface_program, "depth_from_forward", depth.clip_z_from_w)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = "<"
        self._target.viewport = (0, 0, self._atlas.width, self._atlas.height)
        # Infinity where no surface is: fog and defocus treat the background as infinitely far.
        self._target.clear(math.inf, depth=1.0)
        self._target.use()
        self._objects.upload(camera_state.objects)
        clip_from_scene = self._clip_from_mirror @ pose.rotation.T
        # The scene's clusters are culled by face; objects are few and drawn into every face.
        visible = self._scene.clusters.in_front_of_planes(
            frustum_planes(clip_from_scene), viewpoint
        )
        cells: tuple[AtlasCell | LensProjection, ...] = self._atlas.cells
        for cell, clip, visible_clusters in zip(cells, clip_from_scene, visible, strict=True):
            self._context.viewport = cell.viewport
            set_uniform(self._surface_program, "clip_from_scene", clip.T)
            for first, count in visible_runs(visible_clusters, self._scene.clusters.offsets):
                self._vertices.render(vertices=3 * count, first=3 * first)
            self._objects.draw()

    def read(self) -> npt.NDArray[np.float32]:
        """Read the (h, w) ranges of the last frame back, metres."""
        width, height = self._ranges.size
        data = self._range_target.read(components=1, dtype="f4", alignment=1)
        return np.frombuffer(data, dtype=np.float32).reshape(height, width)

    def close(self) -> None:
        """Free the pass's resources; the vertex buffer belongs to the scene."""
        self._objects.close()
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


class _ObjectPositions:
    """Vertex buffers of dynamic objects' corners; none without objects."""

    def __init__(
        self, context: moderngl.Context, program: moderngl.Program, origin: Floats
    ) -> None:
        self._context = context
        self._program = program
        self._origin = origin
        self._buffers: list[tuple[moderngl.VertexArray, moderngl.Buffer]] = []

    def upload(self, objects: tuple[DynamicObject, ...]) -> None:
        """Upload the objects of a camera state at their current poses."""
        # Buffers of the last frame: sizes change with the objects, and only frames with range
        # effects pay.
        self.close()
        for dynamic_object in objects:
            positions = (
                dynamic_object.world_from_object.transform_points(dynamic_object.mesh.corners)
                - self._origin
            )
            buffer = self._context.buffer(positions.astype(np.float32).tobytes())
            attributes = [(buffer, "3f", "position")]
            self._buffers.append((self._context.vertex_array(self._program, attributes), buffer))

    def draw(self) -> None:
        """Draw all objects."""
        for vertices, _ in self._buffers:
            vertices.render()

    def close(self) -> None:
        """Free the buffers."""
        for pair in self._buffers:
            for resource in pair:
                resource.release()
        self._buffers.clear()


def _make_texture(context: moderngl.Context, size: tuple[int, int]) -> moderngl.Texture:
    """Texture of one float32 channel without interpolation."""
    # Half floats would round a range of 10 m to 8 mm.
    texture = context.texture(size, 1, dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return texture
