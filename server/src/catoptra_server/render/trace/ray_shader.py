"""From rays to the colours of pixels: the shading that all of trace's views share."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.trace.embree_objects import (
    EmbreeObjectScenes,
    ObjectInstance,
    intersect_objects,
)
from catoptra_server.render.trace.embree_scene import EmbreeScene, SurfacePoints
from catoptra_server.render.trace.packed_light import Colours, Float32s, Packed, RadianceScale

VisibleHits = tuple[npt.NDArray[np.intp], Packed]
_NO_HITS: VisibleHits = (np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.uint64))


@dataclass(frozen=True, slots=True, eq=False)
class ViewTransform:
    """A camera state as rays need it."""

    rotation: Float32s
    """(3, 3) with world directions = mirror directions @ rotation."""
    origin: Float32s
    """(3,) viewpoint in Embree's coordinates."""
    objects: tuple[ObjectInstance, ...]
    """Dynamic objects at their poses."""


class RayShader(Protocol):
    """Shading of the rays of one scene."""

    scene: EmbreeScene
    """Static scene."""
    channel_dtype: np.dtype[np.uint8] | np.dtype[np.float32]
    """Storage of one colour channel."""
    pixel_dtype: np.dtype[np.void]
    """Storage of a whole pixel, as one opaque element."""

    @property
    def memory_bytes(self) -> int:
        """Size of the shader's own tables."""

    def transform_view(self, camera_state: CameraState) -> ViewTransform:
        """Transform and objects of a camera state, constant within the frame."""

    def has_varying_light(self, triangle: npt.NDArray[np.int32]) -> Bools:
        """(n,) whether radiance varies over each triangle; triangle -1 is the background."""

    def shade_rays(
        self, directions: Float32s, transform: ViewTransform, *, off_mirror: npt.NDArray[np.intp]
    ) -> Colours:
        """Colours of pixels from their rays.

        Args:
            directions: (pixels * samples, 3) unit directions, mirror frame, pixel by pixel.
            transform: Viewpoint and objects.
            off_mirror: Indices of rays that do not see the mirror and are black.

        Returns:
            (pixels, 3) colours.
        """

    def shade_points(
        self,
        triangle: npt.NDArray[np.int32],
        surface_points: SurfacePoints,
        transform: ViewTransform,
    ) -> Colours:
        """(pixels, 3) colours of (pixels * samples,) known points on triangles."""

    def shade_triangles(self, triangle: npt.NDArray[np.int32]) -> Colours:
        """(n, 3) colours of pixels that one triangle, or the background (-1), fills."""


class UnshadowedShader:
    """Radiance of a scene on a scale: encoded sRGB, or linear light."""

    def __init__(
        self, scene: EmbreeScene, objects: EmbreeObjectScenes, scale: RadianceScale
    ) -> None:
        """Tabulate the radiance of every triangle on the scale."""
        self.scene = scene
        self._object_scenes = objects
        self._scale = scale
        self.channel_dtype = scale.channel_dtype
        # A pixel's bytes as one element: twice as fast to look up and to scatter as rows of three.
        self.pixel_dtype = np.dtype(f"V{3 * scale.channel_dtype.itemsize}")
        self._table = scene.radiance_table(self._scale)
        # Without textures and point lights a pixel of one sample is one look-up.
        self._is_tabulated = scale.samples == 1 and not scene.has_varying_light
        self._colour_of_triangle = (
            self._scale.unpack(self._table).view(self.pixel_dtype).reshape(-1)
        )

    @property
    def memory_bytes(self) -> int:
        """Size of the tables of all triangles."""
        return self._table.nbytes + self._colour_of_triangle.nbytes

    def transform_view(self, camera_state: CameraState) -> ViewTransform:
        """Transform and objects of a camera state, constant within the frame."""
        pose = camera_state.world_from_mirror
        return ViewTransform(
            pose.rotation.T.astype(np.float32),
            # Subtracted in float64: both positions may be far from the world's origin.
            (pose.translation - self.scene.origin).astype(np.float32),
            self._object_scenes.place_objects(camera_state.objects, pose.translation, self._scale),
        )

    def shade_rays(
        self, directions: Float32s, transform: ViewTransform, *, off_mirror: npt.NDArray[np.intp]
    ) -> Colours:
        """(pixels, 3) colours of (pixels * samples, 3) rays; rays off the mirror are black."""
        directions = directions @ transform.rotation
        rays, object_radiance = self._visible_object_hits(directions, transform)
        # One look-up of finished colours replaces packing, summing and encoding; only pixels with
        # all rays on the static scene qualify.
        if self._is_tabulated and not len(rays) and not len(off_mirror):
            origins = np.broadcast_to(transform.origin, directions.shape)
            triangle = self.scene.intersect(origins, directions)
            pixels = self._colour_of_triangle.take(triangle, mode="wrap")
            colours: Colours = pixels.view(self.channel_dtype).reshape(-1, 3)
            return colours
        radiance = self._trace_scene(directions, transform, excluded_rays=rays)
        radiance[rays] = object_radiance
        radiance[off_mirror] = 0
        return self._encode_pixels(radiance)

    def has_varying_light(self, triangle: npt.NDArray[np.int32]) -> Bools:
        """(n,) whether radiance varies over each triangle; triangle -1 is the background."""
        return self.scene.is_varying(triangle)

    def shade_points(
        self,
        triangle: npt.NDArray[np.int32],
        surface_points: SurfacePoints,
        transform: ViewTransform,
    ) -> Colours:
        """(pixels, 3) colours of (pixels * samples,) known points on triangles."""
        radiance = self.scene.shade_points(
            triangle, surface_points, table=self._table, scale=self._scale
        )
        return self._encode_pixels(radiance)

    def shade_triangles(self, triangle: npt.NDArray[np.int32]) -> Colours:
        """(n, 3) colours of pixels that one triangle, or the background (-1), fills."""
        # All samples of the pixel are equal: their sum is a product.
        sums = self._table.take(triangle, mode="wrap") * np.uint64(self._scale.samples)
        return self._scale.unpack(sums)

    def _encode_pixels(self, light: Packed) -> Colours:
        """(pixels, 3) colours of (pixels * samples,) packed radiance."""
        return self._scale.unpack(self._scale.sum_pixels(light))

    def _visible_object_hits(self, directions: Float32s, transform: ViewTransform) -> VisibleHits:
        """Rays that hit an object in front of the scene, and the object's radiance."""
        if not transform.objects:
            return _NO_HITS
        object_hits = intersect_objects(transform.objects, directions, self._scale)
        return visible_hits(object_hits, directions, scene=self.scene, origin=transform.origin)

    def _trace_scene(
        self, directions: Float32s, transform: ViewTransform, *, excluded_rays: npt.NDArray[np.intp]
    ) -> Packed:
        """(n,) radiance of the static scene along rays; `excluded_rays` stay zero."""
        look_up = partial(self.scene.trace_radiance, table=self._table, scale=self._scale)
        if not len(excluded_rays):
            return look_up(np.broadcast_to(transform.origin, directions.shape), directions)
        is_traced = np.ones(len(directions), dtype=bool)
        is_traced[excluded_rays] = False
        radiance: Packed = np.zeros(len(directions), dtype=np.uint64)
        traced = directions[is_traced]
        radiance[is_traced] = look_up(np.broadcast_to(transform.origin, traced.shape), traced)
        return radiance


def visible_hits(
    object_hits: tuple[npt.NDArray[np.intp], Float32s, Packed],
    directions: Float32s,
    *,
    scene: EmbreeScene,
    origin: Float32s,
) -> VisibleHits:
    """Those object hits that the static scene does not occlude.

    Args:
        object_hits: Indices of rays, distances, packed radiance.
        directions: (n, 3) directions of all rays, world frame.
        scene: Static scene.
        origin: (3,) origin of the rays in Embree's coordinates.
    """
    rays, distance, radiance = object_hits
    if not len(rays):
        return _NO_HITS
    tested = directions[rays]
    # An occlusion query ends at the first triangle found, so it costs less than a closest hit.
    is_occluded = scene.occludes(np.broadcast_to(origin, tested.shape), tested, distance)
    return rays[~is_occluded], radiance[~is_occluded]


def overwrite_visible_hits(
    light: Packed,
    object_hits: tuple[npt.NDArray[np.intp], Float32s, Packed],
    directions: Float32s,
    *,
    scene: EmbreeScene,
    origin: Float32s,
) -> None:
    """Overwrite the radiance of rays whose object hit is visible."""
    rays, object_radiance = visible_hits(object_hits, directions, scene=scene, origin=origin)
    light[rays] = object_radiance
