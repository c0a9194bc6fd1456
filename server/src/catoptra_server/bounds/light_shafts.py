"""Whether some triangle of a scene can occlude a light from another one: tests of pairs on planes.

The convex hull of a receiver R and of a light is its shaft. A caster T occludes the light from some
point of R only if none of these planes separates them: the plane of R, with T behind it; the plane
of T, with R on the light's side; and the planes through the light and an edge of R or of T. The
last ones are the separating axes of two triangles in the light's projection (Ericson, Real-Time
Collision Detection, 2005, 5.2.10), so that for one caster the test is exact but for a tolerance;
two casters never help each other, so it is exact for the scene: some point of R is hidden or none.
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import ShadowCastingLight
from catoptra_server.world.world_description import DirectionalLight

# Corners this near a plane lie in the plane: sums of float64 coordinates differ by less.
IN_PLANE_M = 1e-6
# A plane that contains the light occludes nothing: a distance, or a cosine for directional lights.
MIN_LIGHT_DISTANCE = 1e-9


class LightShafts:
    """The casters of a scene in one light."""

    def __init__(self, scene: SceneMesh, light: ShadowCastingLight) -> None:
        self._scene = scene
        self._light = light
        corners, normals = scene.corners[scene.casts_shadows], scene.normals[scene.casts_shadows]
        height = np.einsum("ni,ni->n", normals, self._towards(corners[:, 0]))
        reaches = np.abs(height) > MIN_LIGHT_DISTANCE
        self._corners = corners[reaches]
        # Turned away from the light: what the caster can hide lies in front.
        self._normals = -np.sign(height[reaches])[:, None] * normals[reaches]
        self._offsets = np.einsum("ni,ni->n", self._normals, self._corners[:, 0])

    def __len__(self) -> int:
        """Number of casters."""
        return len(self._corners)

    def can_be_hidden(self, receiver: int) -> bool:
        """Whether a triangle of the scene that faces the light is hidden anywhere."""
        corners, normal = self._scene.corners[receiver], self._scene.normals[receiver]
        is_in_front = (self._corners @ normal).max(axis=1) - normal @ corners[0] > IN_PLANE_M
        hides = (self._normals @ corners.T).max(axis=1) - self._offsets > IN_PLANE_M
        casters = self._corners[is_in_front & hides]
        if not len(casters):
            return False
        casters = casters[self._reach_into(corners[None], casters)]
        return bool(self._reach_into(casters, corners[None]).any()) if len(casters) else False

    def _towards(self, points: Floats) -> Floats:
        """(..., 3) vectors from points towards the light."""
        if isinstance(self._light, DirectionalLight):
            return np.broadcast_to(-np.asarray(self._light.direction), points.shape)
        return np.asarray(self._light.position_m) - points

    def _reach_into(self, shafts: Floats, triangles: Floats) -> np.ndarray:
        """(k,) whether triangles reach into the shafts of others, by the shafts' sides.

        Args:
            shafts: (k or 1, 3, 3) triangles between which and the light the shafts lie.
            triangles: (k or 1, 3, 3).
        """
        first, second = shafts, np.roll(shafts, -1, axis=1)
        third = np.roll(shafts, -2, axis=1)
        sides = np.cross(second - first, self._towards(first))
        length = np.linalg.norm(sides, axis=-1, keepdims=True)
        # A side of no area separates nothing.
        sides = np.divide(sides, length, out=np.zeros_like(sides), where=length > 0.0)
        inward = np.einsum("kei,kei->ke", sides, third - first)
        sides *= np.sign(inward)[..., None]
        offsets = np.einsum("kei,kei->ke", sides, first)
        reach = np.einsum("kei,kci->kec", sides, triangles).max(axis=-1) - offsets
        is_inside: np.ndarray = ((reach > IN_PLANE_M) | (inward == 0.0)).all(axis=-1)
        return is_inside
