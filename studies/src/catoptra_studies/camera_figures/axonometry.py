"""Technical drawing of the mirror frame: parallel projection, painter's order, simple shading.

Parallel projection keeps a square face a parallelogram and lengths along an axis comparable.
Points are (..., 3) in the mirror frame (z down); coordinates of the drawing are right and up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Axonometry:
    """Parallel projection for a distant viewer."""

    viewer_from_mirror: Floats
    """(3, 3) rotation with the rows right, up, and towards the viewer."""

    @classmethod
    def from_view_angles(cls, *, azimuth_deg: float, elevation_deg: float) -> Axonometry:
        """The view from an azimuth (x towards y) and an elevation above the horizon."""
        azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
        level = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        # z is down in the mirror frame.
        world_up = np.array([0.0, 0.0, -1.0])
        towards = math.cos(elevation) * level + math.sin(elevation) * world_up
        up = math.cos(elevation) * world_up - math.sin(elevation) * level
        return cls(np.stack((np.cross(up, towards), up, towards)))

    def project(self, points: Floats) -> Floats:
        """(..., 2) coordinates in the drawing of (..., 3) points."""
        return points @ self.viewer_from_mirror[:2].T

    def depth_order(self, polygons: Floats) -> npt.NDArray[np.intp]:
        """(n,) order from far to near of (n, k, 3) polygons."""
        # By centroids, which suffices for small polygons of one smooth surface.
        depth = polygons.mean(axis=1) @ self.viewer_from_mirror[2]
        return np.argsort(depth)

    def normals(self, polygons: Floats) -> Floats:
        """(n, 3) unit normals of (n, 4, 3) polygons in the viewer's frame.

        For polygons of `mirror_polygons` they leave the reflecting side.
        """
        # From the diagonals, which are never parallel, even where two corners coincide at the
        # vertex of the mirror.
        normal = np.cross(polygons[:, 3] - polygons[:, 1], polygons[:, 2] - polygons[:, 0])
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return normal @ self.viewer_from_mirror.T


# Above the viewer's left shoulder, as in technical drawings.
_LIGHT_DIRECTION = np.array([-0.5, 0.15, 0.85])


def shade(normals: Floats) -> Floats:
    """(n,) brightness in [0, 1] of (n, 3) unit normals in the viewer's frame.

    A third of ambient light, Lambert's law, and a highlight after Blinn.
    """
    light = _LIGHT_DIRECTION / np.linalg.norm(_LIGHT_DIRECTION)
    cosine = np.clip(normals @ light, 0.0, None)
    half = light + np.array([0.0, 0.0, 1.0])
    highlight = np.clip(normals @ (half / np.linalg.norm(half)), 0.0, None) ** 30
    brightness: Floats = np.clip(0.35 + 0.5 * cosine + 0.15 * highlight, 0.0, 1.0)
    return brightness
