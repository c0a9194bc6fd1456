"""A scene in Embree's hands, and the light of the triangles that rays meet.

Most light depends on the triangle alone and is looked up. Only where a ray meets a texture, or a
place that a point light reaches, is it computed, for those rays.
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

# Looks beside the indices of textures: light that is the same all over a triangle, and light that
# only point lights make vary.
_CONSTANT_LIGHT = -2
_POINT_LIGHT_ONLY = -1

# Embree answers 1e37 where nothing is met; no scene reaches this far.
_NO_HIT_M = 1e30
# A triangle that nothing reaches, for a scene without any: Embree commits no empty one.
_UNREACHABLE_TRIANGLE = np.full((1, 3, 3), 1e6)


class SurfacePoints(Protocol):
    """Where light is asked for, of some of a number of rays."""

    def positions(self, rays: npt.NDArray[np.intp]) -> Floats:
        """Return (n, 3) places in Embree's coordinates."""

    def uv(self, rays: npt.NDArray[np.intp]) -> tuple[Float32s, Float32s]:
        """Return the two (n,) texture coordinates."""


class EmbreeScene:
    """The triangles of a world, committed for ray queries.

    Thread-safe once built: queries only read. The origin of Embree's coordinates is the middle of
    the scene, so that float32 keeps its precision in a world far from zero.
    """

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self._scene = scene
        self._lights = world.lights
        self._background = world.background
        corners = scene.corners if len(scene) else _UNREACHABLE_TRIANGLE
        self.origin: Floats = 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1)))
        self._embree = rtcore_scene.EmbreeScene()
        TriangleMesh(self._embree, (corners - self.origin).astype(np.float32))
        # The last row is what a ray meets that meets nothing: Embree's index -1, taken with wrap.
        radiance = shading.facet_radiance(scene, world.lights)
        whole = np.concatenate([radiance, [world.background]])
        self._radiance = np.ascontiguousarray(whole.T, dtype=np.float32)  # (3, n + 1)
        self._textures = [PaddedTexture.from_image(texture) for texture in scene.textures]
        self._uv_frames = _uv_frames(scene.uv)
        self._has_point_lights = bool(shading.point_lights(world.lights))
        self._material_index = self._make_material_index()
        self.has_varying_light = bool((self._material_index != _CONSTANT_LIGHT).any())
        self.intersect(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds it now

    def _make_material_index(self) -> npt.NDArray[np.int16]:
        """Return (n + 1,) what varies over each triangle: its texture, or one of two more."""
        look = np.append(self._scene.texture_index, -1).astype(np.int16)
        lit = np.append(~self._scene.unlit, False) & self._has_point_lights
        look[look < 0] = np.where(lit, _POINT_LIGHT_ONLY, _CONSTANT_LIGHT)[look < 0]
        return look

    def radiance_table(self, scale: RadianceScale) -> Packed:
        """Return the (n + 1,) packed light of each triangle, and of the background."""
        return scale.pack(self._radiance)

    def trace_radiance(
        self, origins: Float32s, directions: Float32s, *, table: Packed, scale: RadianceScale
    ) -> Packed:
        """Return the (n,) packed light of what each ray meets."""
        if not self.has_varying_light:
            known: Packed = table.take(self.intersect(origins, directions), mode="wrap")
            return known
        triangle, places = self.closest_hits(origins, directions)
        return self.shade_points(triangle, places, table=table, scale=scale)

    def closest_hits(
        self, origins: Float32s, directions: Float32s
    ) -> tuple[npt.NDArray[np.int32], SurfacePoints]:
        """Return the (n,) triangle that each ray meets, -1 for none, and where."""
        hit = self._embree.run(origins, directions, output=True)
        places = _RayHits(
            origins=origins,
            directions=directions,
            triangle=hit["primID"],
            u=hit["u"],
            v=hit["v"],
            distance=hit["tfar"],
            uv_frames=self._uv_frames,
        )
        return hit["primID"], places

    def shade_points(
        self,
        triangle: npt.NDArray[np.int32],
        surface_points: SurfacePoints,
        *,
        table: Packed,
        scale: RadianceScale,
    ) -> Packed:
        """Return the (n,) packed light of places on (n,) triangles; -1 is the background."""
        light: Packed = table.take(triangle, mode="wrap")
        look = self._material_index.take(triangle, mode="wrap")
        for index in range(_POINT_LIGHT_ONLY if self._has_point_lights else 0, len(self._textures)):
            rays = np.flatnonzero(look == index)
            if len(rays):
                of = triangle.take(rays)
                radiance: Float32s = self._radiance.take(of, axis=1)
                if self._has_point_lights:
                    radiance += self._point_radiance(
                        of, surface_points.positions(rays) + self.origin
                    )
                if index >= 0:
                    radiance *= self._textures[index].sample(*surface_points.uv(rays))
                light[rays] = scale.pack(radiance)
        return light

    @cached_property
    def hemisphere_radiance(self) -> Float32s:
        """Return (3, n + 1) radiance by what nothing hides; the last is the background's."""
        sky = shading.facet_radiance(self._scene, shading.hemisphere_lights(self._lights))
        whole = np.concatenate([sky, [self._background]])
        return np.ascontiguousarray(whole.T, dtype=np.float32)

    def apply_textures(
        self,
        radiance: Float32s,
        rays: npt.NDArray[np.intp],
        triangle: npt.NDArray[np.int32],
        surface_points: SurfacePoints,
    ) -> None:
        """Multiply the (3, k) radiance of (k,) rays by the textures of their (k,) triangles."""
        look = self._material_index.take(triangle)
        for index, texture in enumerate(self._textures):
            of = np.flatnonzero(look == index)
            if len(of):
                radiance[:, of] *= texture.sample(*surface_points.uv(rays.take(of)))

    def is_varying(self, triangle: npt.NDArray[np.int32]) -> Bools:
        """Return (n,) whether light varies over triangles; -1 is the background."""
        return np.asarray(self._material_index.take(triangle, mode="wrap") != _CONSTANT_LIGHT)

    def intersect(self, origins: Float32s, directions: Float32s) -> npt.NDArray[np.int32]:
        """Return the (n,) triangle that each ray meets, -1 for none."""
        hits: npt.NDArray[np.int32] = self._embree.run(origins, directions)
        return hits

    def distances(self, origins: Float32s, directions: Float32s) -> Float32s:
        """Return the (n,) metres to what each unit ray meets, inf where it meets nothing."""
        met = self._embree.run(origins, directions, query="DISTANCE")
        return np.where(met < _NO_HIT_M, met, np.float32(np.inf))

    def occludes(self, origins: Float32s, directions: Float32s, max_distance: Float32s) -> Bools:
        """Return (n,) whether some triangle is met before each ray's distance."""
        answer = self._embree.run(origins, directions, dists=max_distance, query="OCCLUDED")
        return np.asarray(answer >= 0)

    def _point_radiance(self, triangle: npt.NDArray[np.int32], points: Floats) -> Float32s:
        """Return the (3, n) radiance that point lights add at (n, 3) points of (n,) triangles."""
        irradiance = shading.point_irradiance(self._lights, points, self._scene.normals[triangle])
        irradiance[self._scene.unlit[triangle]] = 0.0
        return (self._scene.albedo[triangle] * irradiance).T.astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class _RayHits:
    """What Embree says of rays, and what follows from it for some of them."""

    origins: Float32s
    directions: Float32s
    triangle: npt.NDArray[np.int32]
    u: Float32s
    v: Float32s
    distance: Float32s
    uv_frames: Float32s

    def positions(self, rays: npt.NDArray[np.intp]) -> Floats:
        """Return the places that are met."""
        along = self.distance.take(rays)[:, None] * self.directions[rays]
        points: Floats = (self.origins[rays] + along).astype(np.float64)
        return points

    def uv(self, rays: npt.NDArray[np.intp]) -> tuple[Float32s, Float32s]:
        """Return the two texture coordinates at barycentric (u, v) of corners 1 and 2."""
        u, v = self.u.take(rays), self.v.take(rays)
        a, b, au, bu, av, bv = self.uv_frames.take(self.triangle.take(rays), axis=1)
        return a + u * au + v * av, b + u * bu + v * bv


def _uv_frames(uv: Floats) -> Float32s:
    """Return (6, n) texture coordinates of each triangle's first corner, and its two edges'."""
    a, b, c = np.moveaxis(uv, 1, 0)
    frames = np.concatenate((a, b - a, c - a), axis=-1).astype(np.float32)
    return np.ascontiguousarray(frames.T)
