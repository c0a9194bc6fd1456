"""Technical drawing of the mirror frame: parallel projection, painter's order, simple shading.

Parallel, so that a square face is a parallelogram and a length along an axis can be compared.
Points are (..., 3) in the mirror frame (z down); drawn coordinates are right and up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats


@dataclass(frozen=True, slots=True, eq=False)
class Axonometry:
    """A viewer far away; rows of the (3, 3) rotation: right, up, and towards the viewer."""

    viewer_from_mirror: Floats

    @classmethod
    def from_view_angles(cls, *, azimuth_deg: float, elevation_deg: float) -> Axonometry:
        """Return the view from an azimuth (x towards y) and an elevation above the horizon."""
        azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
        level = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        world_up = np.array([0.0, 0.0, -1.0])
        towards = math.cos(elevation) * level + math.sin(elevation) * world_up
        up = math.cos(elevation) * world_up - math.sin(elevation) * level
        return cls(np.stack((np.cross(up, towards), up, towards)))

    def project(self, points: Floats) -> Floats:
        """Return (..., 2) drawn coordinates of (..., 3) points."""
        return points @ self.viewer_from_mirror[:2].T

    def depth_order(self, polygons: Floats) -> npt.NDArray[np.intp]:
        """Return the (n,) order in which (n, k, 3) polygons hide each other rightly."""
        depth = polygons.mean(axis=1) @ self.viewer_from_mirror[2]
        return np.argsort(depth)

    def normals(self, polygons: Floats) -> Floats:
        """Return (n, 3) unit normals of (n, 4, 3) polygons, in the viewer's frame.

        Out of the mirror's reflecting side for its polygons. From the diagonals: those are never
        parallel, even when two corners coincide.
        """
        normal = np.cross(polygons[:, 3] - polygons[:, 1], polygons[:, 2] - polygons[:, 0])
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return normal @ self.viewer_from_mirror.T

    def front_facing_mask(self, polygons: Floats) -> Bools:
        """Return which (n, 4, 3) polygons turn their normal to the viewer."""
        turned: Bools = self.normals(polygons)[:, 2] > 0.0
        return turned


# The lamp stands above the viewer's left shoulder.
_LIGHT_DIRECTION = np.array([-0.5, 0.15, 0.85])


def shade(normals: Floats) -> Floats:
    """Return (n,) brightness in [0, 1] of (n, 3) unit normals in the viewer's frame.

    Lambert's law and a glint.
    """
    lamp = _LIGHT_DIRECTION / np.linalg.norm(_LIGHT_DIRECTION)
    cosine = np.clip(normals @ lamp, 0.0, None)
    half = lamp + np.array([0.0, 0.0, 1.0])
    glint = np.clip(normals @ (half / np.linalg.norm(half)), 0.0, None) ** 30
    brightness: Floats = np.clip(0.35 + 0.5 * cosine + 0.15 * glint, 0.0, 1.0)
    return brightness
