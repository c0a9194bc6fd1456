"""From rays to the colours of pixels: the part that all of trace's views share."""

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
    """An exposure as rays need it: turned directions are `mirror @ rotation`, from `origin`."""

    rotation: Float32s
    origin: Float32s
    objects: tuple[ObjectInstance, ...]


class RayShader(Protocol):
    """What the rays of a scene bring back.

    channel, pixel: what a colour and a whole pixel are stored as.
    """

    scene: EmbreeScene
    channel_dtype: np.dtype[np.uint8] | np.dtype[np.float32]
    pixel_dtype: np.dtype[np.void]

    def transform_view(self, camera_state: CameraState) -> ViewTransform:
        """Return what does not change within an exposure."""

    def has_varying_light(self, triangle: npt.NDArray[np.int32]) -> Bools:
        """Return (n,) whether light varies over triangles; -1 is the background."""

    def shade_rays(
        self, directions: Float32s, transform: ViewTransform, *, off_mirror: npt.NDArray[np.intp]
    ) -> Colours:
        """Return the (pixels, 3) colours of (pixels * samples, 3) rays; those beside are black."""

    def shade_points(
        self,
        triangle: npt.NDArray[np.int32],
        surface_points: SurfacePoints,
        transform: ViewTransform,
    ) -> Colours:
        """Return the (pixels, 3) colours of (pixels * samples,) known places on triangles."""

    def shade_triangles(self, triangle: npt.NDArray[np.int32]) -> Colours:
        """Return the (n, 3) colours of pixels that triangles, or the background (-1), fill."""


class UnshadowedShader:
    """A scene's light on a scale: finished greys, or linear light.

    channel, pixel: what a colour and a whole pixel are stored as.
    """

    def __init__(
        self, scene: EmbreeScene, objects: EmbreeObjectScenes, scale: RadianceScale
    ) -> None:
        self.scene = scene
        self._object_scenes = objects
        self._scale = scale
        self.channel_dtype = scale.channel_dtype
        # A pixel's bytes as one element: twice as fast as rows of three to look up and to scatter.
        self.pixel_dtype = np.dtype(f"V{3 * scale.channel_dtype.itemsize}")
        self._table = scene.radiance_table(self._scale)
        # Of a scene without textures and point lights, one sample a pixel is one look-up.
        self._is_tabulated = scale.samples == 1 and not scene.has_varying_light
        self._colour_of_triangle = (
            self._scale.unpack(self._table).view(self.pixel_dtype).reshape(-1)
        )

    def transform_view(self, camera_state: CameraState) -> ViewTransform:
        """Return what does not change within an exposure."""
        pose = camera_state.world_from_mirror
        return ViewTransform(
            pose.rotation.T.astype(np.float32),
            (pose.translation - self.scene.origin).astype(np.float32),
            self._object_scenes.place_objects(camera_state.objects, pose.translation, self._scale),
        )

    def shade_rays(
        self, directions: Float32s, transform: ViewTransform, *, off_mirror: npt.NDArray[np.intp]
    ) -> Colours:
        """Return the (pixels, 3) colours of (pixels * samples, 3) rays; those beside are black."""
        directions = directions @ transform.rotation
        rays, of_bodies = self._visible_object_hits(directions, transform)
        if self._is_tabulated and not len(rays) and not len(off_mirror):
            origins = np.broadcast_to(transform.origin, directions.shape)
            triangle = self.scene.intersect(origins, directions)
            whole = self._colour_of_triangle.take(triangle, mode="wrap")
            known: Colours = whole.view(self.channel_dtype).reshape(-1, 3)
            return known
        light = self._trace_scene(directions, transform, excluded_rays=rays)
        light[rays] = of_bodies
        light[off_mirror] = 0
        return self._encode_pixels(light)

    def has_varying_light(self, triangle: npt.NDArray[np.int32]) -> Bools:
        """Return (n,) whether light varies over triangles; -1 is the background."""
        return self.scene.is_varying(triangle)

    def shade_points(
        self,
        triangle: npt.NDArray[np.int32],
        surface_points: SurfacePoints,
        transform: ViewTransform,
    ) -> Colours:
        """Return the (pixels, 3) colours of (pixels * samples,) known places on triangles."""
        light = self.scene.shade_points(
            triangle, surface_points, table=self._table, scale=self._scale
        )
        return self._encode_pixels(light)

    def shade_triangles(self, triangle: npt.NDArray[np.int32]) -> Colours:
        """Return the (n, 3) colours of pixels that triangles, or the background (-1), fill."""
        light = self._table.take(triangle, mode="wrap") * np.uint64(self._scale.samples)
        return self._scale.unpack(light)

    def _encode_pixels(self, light: Packed) -> Colours:
        return self._scale.unpack(self._scale.sum_pixels(light))

    def _visible_object_hits(self, directions: Float32s, transform: ViewTransform) -> VisibleHits:
        """Return the rays that meet a body which the scene does not hide, and its light."""
        if not transform.objects:
            return _NO_HITS
        met = intersect_objects(transform.objects, directions, self._scale)
        return visible_hits(met, directions, scene=self.scene, origin=transform.origin)

    def _trace_scene(
        self, directions: Float32s, transform: ViewTransform, *, excluded_rays: npt.NDArray[np.intp]
    ) -> Packed:
        """Return the (n,) light that the scene has along rays; some need not be asked."""
        look_up = partial(self.scene.trace_radiance, table=self._table, scale=self._scale)
        if not len(excluded_rays):
            return look_up(np.broadcast_to(transform.origin, directions.shape), directions)
        is_asked = np.ones(len(directions), dtype=bool)
        is_asked[excluded_rays] = False
        light: Packed = np.zeros(len(directions), dtype=np.uint64)
        along = directions[is_asked]
        light[is_asked] = look_up(np.broadcast_to(transform.origin, along.shape), along)
        return light


def visible_hits(
    object_hits: tuple[npt.NDArray[np.intp], Float32s, Packed],
    directions: Float32s,
    *,
    scene: EmbreeScene,
    origin: Float32s,
) -> VisibleHits:
    """Return those of the rays that met a body which the scene does not hide, and their light."""
    rays, distance, of_bodies = object_hits
    if not len(rays):
        return _NO_HITS
    along = directions[rays]
    hidden = scene.occludes(np.broadcast_to(origin, along.shape), along, distance)
    return rays[~hidden], of_bodies[~hidden]


def overwrite_visible_hits(
    light: Packed,
    object_hits: tuple[npt.NDArray[np.intp], Float32s, Packed],
    directions: Float32s,
    *,
    scene: EmbreeScene,
    origin: Float32s,
) -> None:
    """Replace the light of rays that met a body which the scene does not hide."""
    rays, of_bodies = visible_hits(object_hits, directions, scene=scene, origin=origin)
    light[rays] = of_bodies
