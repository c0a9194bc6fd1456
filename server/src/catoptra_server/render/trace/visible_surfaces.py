"""The surfaces of a scene from one viewpoint: their distances in every direction.

A plane at viewpoint v has 1 / distance = m . d for unit directions d, with one vector m. Texture
coordinates on the plane are (a . d) / (m . d). So the image of a plane needs no rays in cells that
only this plane fills.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.packed_light import Float32s
from catoptra_server.render.trace.surfaces import BACKGROUND, find_surfaces, uv_planes
from catoptra_server.scene.scene_mesh import SceneMesh

# Seen at less than two milliradians a plane is left to rays: there m . d loses three of float32's
# seven digits, nearly what `SilhouetteEdges` tolerates.
_GRAZING_RAD = 2e-3


@dataclass(frozen=True, slots=True, eq=False)
class VisibleSurfaces:
    """Planes of one frame, in the mirror frame."""

    usable: Bools
    """(s,) whether a surface may be filled."""
    inverse_distance: Float32s
    """(s, 3) vector m of each plane."""
    uv: Float32s
    """(s, 2, 3) vector a of each texture coordinate."""


@dataclass(frozen=True, slots=True, eq=False)
class PlanePoints:
    """Points at which directions of cells hit their cells' planes."""

    directions: Float32s
    """(k, m, 3) directions, mirror frame."""
    turned: Float32s
    viewpoint: Float32s
    """(3,) viewpoint in Embree's coordinates."""
    inverse_distance: Float32s
    """(k, 3) vector m of each cell's plane."""
    uv_vectors: Float32s
    """(k, 2, 3) vectors a of each cell's plane."""

    def positions(self, rays: npt.NDArray[np.intp]) -> Floats:
        """(n, 3) positions on some of the k * m rays, in Embree's coordinates."""
        inverse = self._along(rays, self.inverse_distance)
        turned: Float32s = self.directions.reshape(-1, 3).take(rays, axis=0) @ self.turned
        return self.viewpoint + turned / inverse[:, None]

    def uv(self, rays: npt.NDArray[np.intp]) -> tuple[Float32s, Float32s]:
        """The two (n,) texture coordinates."""
        inverse = self._along(rays, self.inverse_distance)
        a, b = (self._along(rays, self.uv_vectors[:, k]) / inverse for k in (0, 1))
        return a, b

    def _along(self, rays: npt.NDArray[np.intp], vectors: Float32s) -> Float32s:
        """(n,) products of rays with their cells' vectors."""
        whole = np.einsum("kmi,ki->km", self.directions, vectors)
        products: Float32s = whole.reshape(-1).take(rays)
        return products


class SurfacePlanes:
    """The planes of a scene's surfaces: normals, positions, textures."""

    def __init__(self, scene: SceneMesh) -> None:
        self.surfaces = surfaces = find_surfaces(scene)
        real = surfaces.triangle[BACKGROUND + 1 :]
        none = np.zeros((BACKGROUND + 1, 3))
        self._normals = np.concatenate((none, scene.normals[real]))
        self._points = np.concatenate((none, scene.corners[real, 0]))
        self._is_real = surfaces.triangle >= 0
        self._textured = np.flatnonzero(
            self._is_real & (np.append(scene.texture_index, -1)[surfaces.triangle] >= 0)
        )
        self._uv_offset, self._uv_gradient = uv_planes(scene, surfaces.triangle[self._textured])

    def view_from(self, world_from_mirror: Pose) -> VisibleSurfaces:
        """Surfaces as seen from a pose."""
        viewpoint, rotation = world_from_mirror.translation, world_from_mirror.rotation
        height = np.einsum("si,si->s", self._points - viewpoint, self._normals)
        farthest = np.linalg.norm(self.surfaces.centre - viewpoint, axis=-1) + self.surfaces.reach_m
        usable = np.abs(height) > _GRAZING_RAD * farthest
        usable &= self._is_real
        vector = self._normals / np.where(usable, height, 1.0)[:, None]
        uv = np.zeros((len(vector), 2, 3), dtype=np.float32)
        here = self._uv_offset + self._uv_gradient @ viewpoint
        of_textured = here[..., None] * vector[self._textured][:, None] + self._uv_gradient
        uv[self._textured] = of_textured @ rotation
        usable[BACKGROUND] = True
        return VisibleSurfaces(usable, (vector @ rotation).astype(np.float32), uv)
