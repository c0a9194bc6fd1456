"""A static scene in Embree, and the radiance of the triangles that rays hit.

Most radiance depends on the triangle alone and comes from a table. Only hits on a texture, or on a
surface that a point light reaches, are shaded one by one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.trace.packed_light import Float32s, Packed, RadianceScale
from catoptra_server.render.trace.padded_texture import PaddedTexture
from catoptra_server.scene import shading
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.world_description import World

# Material indices beside those of textures: light constant over a triangle, and light that only
# point lights make vary.
_CONSTANT_LIGHT = -2
_POINT_LIGHT_ONLY = -1

# Embree reports 1e37 for a miss; no scene extends this far.
_NO_HIT_M = 1e30
# A triangle beyond all views, for a world without surfaces: Embree commits no empty scene.
_UNREACHABLE_TRIANGLE = np.full((1, 3, 3), 1e6)


class SurfacePoints(Protocol):
    """Points on surfaces to be shaded, indexed by ray."""

    def positions(self, rays: npt.NDArray[np.intp]) -> Floats:
        """(n, 3) positions of the chosen rays' points, in Embree's coordinates."""

    def uv(self, rays: npt.NDArray[np.intp]) -> tuple[Float32s, Float32s]:
        """The two (n,) texture coordinates of the chosen rays' points."""


class EmbreeScene:
    """The triangles of a world, committed for ray queries.

    Thread-safe once built: queries only read. The origin of Embree's coordinates is the scene's
    centre, so that float32 keeps its precision in a world far from the origin.
    """

    def __init__(self, scene: SceneMesh, world: World) -> None:
        """Commit the triangles and tabulate their radiance without point lights and textures."""
        self._scene = scene
        self._lights = world.lights
        self._background = world.background
        corners = scene.corners if len(scene) else _UNREACHABLE_TRIANGLE
        self.origin: Floats = 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1)))
        self._embree = rtcore_scene.EmbreeScene()
        TriangleMesh(self._embree, (corners - self.origin).astype(np.float32))
        # The last column is the background: take() with wrap maps Embree's index -1 to it.
        radiance = shading.facet_radiance(scene, world.lights)
        radiance_by_index = np.concatenate([radiance, [world.background]])
        self._radiance = np.ascontiguousarray(radiance_by_index.T, dtype=np.float32)  # (3, n + 1)
        self._textures = [PaddedTexture.from_image(texture) for texture in scene.textures]
        self._uv_frames = _uv_frames(scene.uv)
        self._has_point_lights = bool(shading.point_lights(world.lights))
        self._material_index = self._make_material_index()
        self.has_varying_light = bool((self._material_index != _CONSTANT_LIGHT).any())
        # Embree builds its hierarchy at the first query: now, not in the first frame.
        self.intersect(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def _make_material_index(self) -> npt.NDArray[np.int16]:
        """(n + 1,) shading of each triangle: index of its texture, or one of two constants."""
        index = np.append(self._scene.texture_index, -1).astype(np.int16)
        is_point_lit = np.append(~self._scene.unlit, False) & self._has_point_lights
        # The last entry is the background, which no light reaches.
        index[index < 0] = np.where(is_point_lit, _POINT_LIGHT_ONLY, _CONSTANT_LIGHT)[index < 0]
        return index

    def radiance_table(self, scale: RadianceScale) -> Packed:
        """(n + 1,) packed radiance of each triangle; the last entry is the background."""
        return scale.pack(self._radiance)

    def trace_radiance(
        self, origins: Float32s, directions: Float32s, *, table: Packed, scale: RadianceScale
    ) -> Packed:
        """(n,) packed radiance along rays, from (n, 3) origins along (n, 3) directions."""
        # Without textures and point lights a triangle index is all that shading needs: Embree then
        # skips barycentric coordinates and distances.
        if not self.has_varying_light:
            radiance: Packed = table.take(self.intersect(origins, directions), mode="wrap")
            return radiance
        triangle, surface_points = self.closest_hits(origins, directions)
        return self.shade_points(triangle, surface_points, table=table, scale=scale)

    def closest_hits(
        self, origins: Float32s, directions: Float32s
    ) -> tuple[npt.NDArray[np.int32], SurfacePoints]:
        """Closest triangle along each ray, and the hit points.

        Returns:
            (n,) triangle indices, -1 for the background, and the points of all rays.
        """
        hit = self._embree.run(origins, directions, output=True)
        surface_points = _RayHits(
            origins=origins,
            directions=directions,
            triangle=hit["primID"],
            u=hit["u"],
            v=hit["v"],
            distance=hit["tfar"],
            uv_frames=self._uv_frames,
        )
        return hit["primID"], surface_points

    def shade_points(
        self,
        triangle: npt.NDArray[np.int32],
        surface_points: SurfacePoints,
        *,
        table: Packed,
        scale: RadianceScale,
    ) -> Packed:
        """(n,) packed radiance of points on (n,) triangles; triangle -1 is the background."""
        packed: Packed = table.take(triangle, mode="wrap")
        material = self._material_index.take(triangle, mode="wrap")
        # One pass per texture over all rays that hit it: NumPy needs arrays of one texture.
        for index in range(_POINT_LIGHT_ONLY if self._has_point_lights else 0, len(self._textures)):
            rays = np.flatnonzero(material == index)
            if len(rays):
                triangles = triangle.take(rays)
                radiance: Float32s = self._radiance.take(triangles, axis=1)
                if self._has_point_lights:
                    # Albedo and texture multiply the sum of all lights, so point lights come
                    # before the texture.
                    radiance += self._point_radiance(
                        triangles, surface_points.positions(rays) + self.origin
                    )
                if index >= 0:
                    radiance *= self._textures[index].sample(*surface_points.uv(rays))
                packed[rays] = scale.pack(radiance)
        return packed

    @cached_property
    def hemisphere_radiance(self) -> Float32s:
        """(3, n + 1) radiance by lights that nothing occludes; the background comes last."""
        radiance = shading.facet_radiance(self._scene, shading.hemisphere_lights(self._lights))
        radiance_by_index = np.concatenate([radiance, [self._background]])
        return np.ascontiguousarray(radiance_by_index.T, dtype=np.float32)

    def apply_textures(
        self,
        radiance: Float32s,
        rays: npt.NDArray[np.intp],
        triangle: npt.NDArray[np.int32],
        surface_points: SurfacePoints,
    ) -> None:
        """Multiply the (3, k) radiance of (k,) rays by the textures of their (k,) triangles."""
        material = self._material_index.take(triangle)
        for index, texture in enumerate(self._textures):
            selected = np.flatnonzero(material == index)
            if len(selected):
                radiance[:, selected] *= texture.sample(*surface_points.uv(rays.take(selected)))

    def is_varying(self, triangle: npt.NDArray[np.int32]) -> Bools:
        """(n,) whether radiance varies over each triangle; triangle -1 is the background."""
        return np.asarray(self._material_index.take(triangle, mode="wrap") != _CONSTANT_LIGHT)

    def intersect(self, origins: Float32s, directions: Float32s) -> npt.NDArray[np.int32]:
        """(n,) closest triangle along each ray, -1 for none."""
        hits: npt.NDArray[np.int32] = self._embree.run(origins, directions)
        return hits

    def distances(self, origins: Float32s, directions: Float32s) -> Float32s:
        """(n,) distances along unit rays, metres; inf for rays without a hit."""
        distance = self._embree.run(origins, directions, query="DISTANCE")
        return np.where(distance < _NO_HIT_M, distance, np.float32(np.inf))

    def occludes(self, origins: Float32s, directions: Float32s, max_distance: Float32s) -> Bools:
        """(n,) whether some triangle lies before each ray's `max_distance`."""
        occluder = self._embree.run(origins, directions, dists=max_distance, query="OCCLUDED")
        return np.asarray(occluder >= 0)

    def _point_radiance(self, triangle: npt.NDArray[np.int32], points: Floats) -> Float32s:
        """(3, n) radiance that point lights add at (n, 3) positions on (n,) triangles."""
        irradiance = shading.point_irradiance(self._lights, points, self._scene.normals[triangle])
        irradiance[self._scene.unlit[triangle]] = 0.0
        return (self._scene.albedo[triangle] * irradiance).T.astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class _RayHits:
    """Hits of a batch of rays as Embree reports them."""

    origins: Float32s
    """(n, 3) origins, Embree's coordinates."""
    directions: Float32s
    """(n, 3) unit directions."""
    triangle: npt.NDArray[np.int32]
    """(n,) triangle indices, -1 for none."""
    u: Float32s
    """(n,) barycentric weight of corner 1."""
    v: Float32s
    """(n,) barycentric weight of corner 2."""
    distance: Float32s
    """(n,) distances along the rays."""
    uv_frames: Float32s
    """(6, triangles) texture coordinates of corner 0 and of the two edges."""

    def positions(self, rays: npt.NDArray[np.intp]) -> Floats:
        """(n, 3) hit positions of the chosen rays."""
        offsets = self.distance.take(rays)[:, None] * self.directions[rays]
        points: Floats = (self.origins[rays] + offsets).astype(np.float64)
        return points

    def uv(self, rays: npt.NDArray[np.intp]) -> tuple[Float32s, Float32s]:
        """The two (n,) texture coordinates of the chosen rays' hits."""
        u, v = self.u.take(rays), self.v.take(rays)
        a, b, au, bu, av, bv = self.uv_frames.take(self.triangle.take(rays), axis=1)
        return a + u * au + v * av, b + u * bu + v * bv


def _uv_frames(uv: Floats) -> Float32s:
    """(6, n) texture coordinates of each triangle's first corner and of its two edges."""
    a, b, c = np.moveaxis(uv, 1, 0)
    # Edges instead of corners: coordinates at barycentric (u, v) are then two products and two
    # sums.
    frames = np.concatenate((a, b - a, c - a), axis=-1).astype(np.float32)
    return np.ascontiguousarray(frames.T)
