"""A scene in Embree's hands, and the light of the triangles that rays meet.

Most light depends on the triangle alone and is looked up. Only where a ray meets a texture, or a
place that a point light reaches, is it computed, for those rays.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render import shading
from catoptra_server.render.trace.packed_light import Float32s, LightScale, Packed
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh

# A triangle that nothing reaches, for a scene without any: Embree commits no empty one.
_NOWHERE = np.full((1, 3, 3), 1e6)


class EmbreeScene:
    """The triangles of a world, committed for ray queries.

    Thread-safe once built: queries only read. The origin of Embree's coordinates is the middle of
    the scene, so that float32 keeps its precision in a world far from zero.
    """

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self._scene = scene
        self._lights = world.lights
        corners = scene.corners if len(scene) else _NOWHERE
        self.origin: Floats = 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1)))
        self._embree = rtcore_scene.EmbreeScene()
        TriangleMesh(self._embree, (corners - self.origin).astype(np.float32))
        # The last row is what a ray meets that meets nothing: Embree's index -1, taken with wrap.
        radiance = shading.facet_radiance(scene, world.lights)
        self._radiance = np.concatenate([radiance, [world.background]]).astype(np.float32)
        self._textures = [linear_from_srgb(t / 255.0).astype(np.float32) for t in scene.textures]
        self._texture_of = np.append(scene.texture_index, np.int32(-1))
        self._has_point_lights = bool(shading.point_lights(world.lights))
        self._uv_frames = _uv_frames(scene.uv)
        self._varies = self._varying_triangles()
        self._query(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds it now

    def _varying_triangles(self) -> npt.NDArray[np.bool_] | None:
        """Return (n + 1,) which triangles' light varies over them; None if that of none does."""
        varies = self._texture_of >= 0
        if self._has_point_lights:
            varies |= np.append(~self._scene.unlit, False)
        return varies if varies.any() else None

    def light_table(self, scale: LightScale) -> Packed:
        """Return the (n + 1,) packed light of each triangle, and of the background."""
        return scale.packed(self._radiance)

    def hit_light(
        self, origins: Float32s, directions: Float32s, *, table: Packed, scale: LightScale
    ) -> Packed:
        """Return the (n,) packed light of what each ray meets."""
        if self._varies is None:
            known: Packed = table.take(self._query(origins, directions), mode="wrap")
            return known
        hit = self._embree.run(origins, directions, output=True)
        triangle = hit["primID"]
        light: Packed = table.take(triangle, mode="wrap")
        rays = np.flatnonzero(self._varies.take(triangle, mode="wrap"))
        if len(rays):
            which = triangle[rays]
            weights = hit["u"][rays, None], hit["v"][rays, None]
            radiance = self._lit(which, origins[rays], directions[rays], hit["tfar"][rays, None])
            self._apply_textures(radiance, which, weights)
            light[rays] = scale.packed(radiance)
        return light

    def _query(self, origins: Float32s, directions: Float32s) -> npt.NDArray[np.int32]:
        hits: npt.NDArray[np.int32] = self._embree.run(origins, directions)
        return hits

    def _lit(
        self,
        triangle: npt.NDArray[np.int32],
        origins: Float32s,
        directions: Float32s,
        distance: Float32s,
    ) -> Float32s:
        """Return (n, 3) radiance without textures where rays meet (n,) triangles."""
        radiance: Float32s = self._radiance.take(triangle, axis=0)
        if self._has_point_lights:
            lit = np.flatnonzero(~self._scene.unlit[triangle])
            which = triangle[lit]
            points = origins[lit] + distance[lit] * directions[lit] + self.origin
            irradiance = shading.point_irradiance(self._lights, points, self._scene.normals[which])
            radiance[lit] += self._scene.albedo[which] * irradiance
        return radiance

    def _apply_textures(
        self,
        radiance: Float32s,
        triangle: npt.NDArray[np.int32],
        weights: tuple[Float32s, Float32s],
    ) -> None:
        """Multiply (n, 3) radiance by the textures at barycentric weights of corners 1 and 2."""
        texture_of_hit = self._texture_of.take(triangle)
        for index, texture in enumerate(self._textures):
            hits = np.flatnonzero(texture_of_hit == index)
            if len(hits):
                frame = self._uv_frames.take(triangle[hits], axis=0)
                u, v = (weight[hits] for weight in weights)
                uv = frame[:, :2] + u * frame[:, 2:4] + v * frame[:, 4:]
                radiance[hits] *= shading.texture_value(texture, uv)


def _uv_frames(uv: Floats) -> Float32s:
    """Return (n, 6) texture coordinates of each triangle's first corner, and its two edges'."""
    a, b, c = np.moveaxis(uv, 1, 0)
    return np.concatenate((a, b - a, c - a), axis=-1).astype(np.float32)
