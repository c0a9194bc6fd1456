"""The first pass: what is seen from the viewpoint, the scene and then what moves in it.

For a mirror that is the faces of the cube, in an atlas; for a camera with a lens, its picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import moderngl
import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.projection.depth_range import MAX_NEAR_M, DepthRange
from catoptra_server.render.raster.dynamic_object_buffer import object_distance_range
from catoptra_server.render.raster.passes import LINEAR_DTYPE
from catoptra_server.render.raster.scene_buffers import LitScene, SceneBuffers


class Projection(Protocol):
    """One flat picture of what is around the viewpoint, and where it lies: atlas.Cell says more."""

    @property
    def width(self) -> int:
        """Return the number of columns of texels."""

    @property
    def height(self) -> int:
        """Return the number of rows of texels."""

    @property
    def viewport(self) -> tuple[int, int, int, int]:
        """Return the rectangle as OpenGL takes it."""

    @property
    def clip_from_mirror(self) -> Floats:
        """Return the (3, 3) map from directions in the mirror frame to clip x, y and w."""

    @property
    def max_depth_ratio(self) -> float:
        """Return the largest distance from the viewpoint of what is one metre ahead, in metres."""


class FaceLayout(Protocol):
    """A texture of flat pictures: an atlas of faces, or one lens."""

    @property
    def width(self) -> int:
        """Return the number of columns of texels."""

    @property
    def height(self) -> int:
        """Return the number of rows of texels."""

    @property
    def cells(self) -> Sequence[Projection]:
        """Return the pictures."""


FaceLayoutT = TypeVar("FaceLayoutT", bound=FaceLayout)


@dataclass(frozen=True, slots=True)
class DrawCounts:
    """What a frame's faces cost: cells with their texels, draw calls, triangles sent."""

    num_cells: int
    num_texels: int
    num_draw_calls: int
    num_triangles: int


def frame_depth_range(
    scene: SceneBuffers, camera_state: CameraState, max_depth_ratio: float
) -> DepthRange:
    """Return between which distances faces are drawn; spread: the largest of their cells'."""
    at = camera_state.world_from_mirror.translation
    reach = object_distance_range(camera_state.objects, at, MAX_NEAR_M * max_depth_ratio)
    return scene.depth_range_finder.find_range(
        at - scene.origin, max_depth_ratio=max_depth_ratio, object_distances_m=reach
    )


def frustum_planes(clip_from_scene: Floats) -> Floats:
    """Return the (n, 5, 3) normals of the planes around what (n, 3, 3) maps show."""
    x, y, w = np.moveaxis(clip_from_scene, 1, 0)
    return np.stack((w + x, w - x, w + y, w - y, w), axis=1)


class FacePass(Generic[FaceLayoutT]):
    """The atlas of one view, and how it is filled."""

    name = "faces"

    def __init__(
        self,
        context: moderngl.Context,
        scene: SceneBuffers,
        atlas: FaceLayoutT,
        samples: int,
    ) -> None:
        if samples > context.max_samples:
            raise DomainError(
                f"this OpenGL takes at most {context.max_samples} samples a texel, not {samples}"
            )
        self._context = context
        self._scene = scene
        self.atlas = atlas
        self._clip_from_mirror = np.stack([cell.clip_from_mirror for cell in atlas.cells])
        self._max_depth_ratio = max(cell.max_depth_ratio for cell in atlas.cells)
        self._texels = sum(cell.width * cell.height for cell in atlas.cells)
        size = (atlas.width, atlas.height)
        self.texture = context.texture(size, 4, dtype=LINEAR_DTYPE)
        self.texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
        self.texture.repeat_x = self.texture.repeat_y = False
        multi = samples if samples > 1 else 0
        colour = (
            context.texture(size, 4, dtype=LINEAR_DTYPE, samples=multi) if multi else self.texture
        )
        depth = context.depth_renderbuffer(size, samples=multi)
        self._target = context.framebuffer([colour], depth)
        self._resolved = context.framebuffer([self.texture]) if multi else None
        self._owned = [self._target, depth, *((colour, self._resolved) if multi else ())]
        self.counts = DrawCounts(0, 0, 0, 0)

    def draw(self, camera_state: CameraState) -> None:
        """Fill the atlas with what is seen from an exposure's viewpoint."""
        pose = camera_state.world_from_mirror
        viewpoint = pose.translation - self._scene.origin
        depth = frame_depth_range(self._scene, camera_state, self._max_depth_ratio)
        scene = self._scene.with_lighting(camera_state)
        scene.dynamic_objects.upload(camera_state.objects)
        scene.set_frame(viewpoint, depth.clip_z_from_w)
        self._begin()
        clip_from_scene = self._clip_from_mirror @ pose.rotation.T
        calls, triangles = self._draw_cells(scene, clip_from_scene, viewpoint)
        if self._resolved is not None:
            self._context.copy_framebuffer(self._resolved, self._target)
        self.counts = DrawCounts(len(self.atlas.cells), self._texels, calls, triangles)

    def _begin(self) -> None:
        """Clear the whole target at once, which drivers do much faster than a part of it."""
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._context.depth_func = "<"
        self._target.viewport = (0, 0, self.atlas.width, self.atlas.height)
        self._target.clear(*self._scene.background, 1.0, depth=1.0)
        self._target.use()

    def _draw_cells(
        self, scene: LitScene, clip_from_scene: Floats, viewpoint: Floats
    ) -> tuple[int, int]:
        """Draw all faces by their (n, 3, 3) maps; return the draw calls and the triangles sent."""
        planes = frustum_planes(clip_from_scene)
        visible = self._scene.clusters.in_front_of_planes(planes, viewpoint)
        calls, triangles = 0, int((visible @ self._scene.cluster_sizes).sum())
        for cell, clip, edges, seen in zip(
            self.atlas.cells, clip_from_scene, planes, visible, strict=True
        ):
            self._context.viewport = cell.viewport
            more_calls, more = scene.dynamic_objects.draw(clip, edges, viewpoint)
            calls += scene.draw(clip, seen) + more_calls
            triangles += more
        return calls, triangles

    def close(self) -> None:
        """Free the atlas."""
        for resource in (*self._owned, self.texture):
            resource.release()
