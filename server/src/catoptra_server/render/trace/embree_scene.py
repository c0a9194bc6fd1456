"""A scene in Embree's hands, and the radiance of the triangles that rays meet."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render import shading
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.description import Rgb, World
from catoptra_server.scene.meshes import SceneMesh

Float32s = npt.NDArray[np.float32]


class EmbreeScene:
    """The triangles of a world, committed for ray queries, with their shading tables.

    Thread-safe once built: queries only read. The origin of Embree's coordinates is the middle of
    the scene, so that float32 keeps its precision in a world far from zero.
    """

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self._scene = scene
        self._lights = world.lights
        corners = scene.corners if len(scene) else np.full((1, 3, 3), 1e6)  # Embree refuses none
        self.origin: Floats = 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1)))
        self._embree = rtcore_scene.EmbreeScene()
        TriangleMesh(self._embree, (corners - self.origin).astype(np.float32))
        # The last row is what a ray meets that meets nothing: index -1.
        self.radiance = _with_background(
            shading.facet_radiance(scene, world.lights), world.background
        )
        self.has_textures = bool((scene.texture_index >= 0).any())
        self.has_point_lights = bool(shading.point_lights(world.lights))
        self._textures = [linear_from_srgb(t / 255.0) for t in scene.textures]
        self._commit()

    def _commit(self) -> None:
        """Build the hierarchy now, in one thread: the first query would do it."""
        self.hit_triangles(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    @property
    def needs_hit_points(self) -> bool:
        """Return whether radiance depends on more than the triangle."""
        return self.has_textures or self.has_point_lights

    def hit_triangles(self, origins: Float32s, directions: Float32s) -> npt.NDArray[np.int32]:
        """Return the (n,) triangle that each ray meets first; -1 = none."""
        hits: npt.NDArray[np.int32] = self._embree.run(origins, directions)
        return hits

    def hit_radiance(self, origins: Float32s, directions: Float32s) -> Float32s:
        """Return the (n, 3) linear radiance of what rays meet, textures and point lights in."""
        hit = self._embree.run(origins, directions, output=True)
        triangle = hit["primID"]
        radiance: Float32s = self.radiance[triangle]
        if self.has_point_lights:
            self._add_point_lights(radiance, triangle, origins, directions, hit["tfar"])
        if self.has_textures:
            self._apply_textures(radiance, triangle, hit["u"], hit["v"])
        return radiance

    def _add_point_lights(
        self,
        radiance: Float32s,
        triangle: npt.NDArray[np.int32],
        origins: Float32s,
        directions: Float32s,
        distance: Float32s,
    ) -> None:
        lit = np.flatnonzero(triangle >= 0)
        lit = lit[~self._scene.unlit[triangle[lit]]]
        which = triangle[lit]
        points = origins[lit] + distance[lit, None] * directions[lit] + self.origin
        irradiance = shading.point_irradiance(self._lights, points, self._scene.normals[which])
        radiance[lit] += self._scene.albedo[which] * irradiance

    def _apply_textures(
        self, radiance: Float32s, triangle: npt.NDArray[np.int32], u: Float32s, v: Float32s
    ) -> None:
        texture_of_hit = np.where(triangle >= 0, self._scene.texture_index[triangle], -1)
        for index, texture in enumerate(self._textures):
            hits = np.flatnonzero(texture_of_hit == index)
            if not len(hits):
                continue
            corners = self._scene.uv[triangle[hits]]
            a, b = u[hits, None], v[hits, None]
            uv = (1.0 - a - b) * corners[:, 0] + a * corners[:, 1] + b * corners[:, 2]
            radiance[hits] *= shading.texture_value(texture, uv)


def _with_background(radiance: Floats, background: Rgb) -> Float32s:
    rows = np.concatenate([radiance, np.asarray(background)[None]])
    return rows.astype(np.float32)
