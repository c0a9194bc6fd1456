"""Projection of a perspective camera, and the near and far planes of every frame.

OpenGL projects a perspective image by itself. A lens with another model, such as a fish-eye, is
looked up in the cube's faces pixel by pixel, as the mirror is.

A depth buffer of 24 bits resolves d^2 / (near 2^24) at a distance d. With a near plane that always
suits a wall against the robot, lines painted a millimetre above a floor would flicker from six
metres on; so the near plane is as far out as the nearest surface allows. Reversed depth, the other
remedy, needs a clip range of [0, 1], which OpenGL 3.3 does not have.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.triangles import TriangleClusters

# Surfaces nearer than a millimetre are clipped: no nearer plane leaves depth for the far ones.
_MIN_NEAR_M = 0.001
# A farther near plane gains nothing: at 0.1 m the buffer resolves 0.25 mm at 20 m.
MAX_NEAR_M = 0.1
# The far plane lies this much beyond the farthest corner, for the rounding of depth.
_FAR_MARGIN = 1.01


@dataclass(frozen=True, slots=True, eq=False)
class LensProjection:
    """An image with samples x samples texels a pixel."""

    camera: PerspectiveCamera
    """Size and field of view of the image."""
    samples: int
    """Samples along a pixel's side."""
    mirror_from_camera: Floats
    """(3, 3) rotation of the camera's frame in the mirror frame."""

    @property
    def width(self) -> int:
        """Number of columns of texels."""
        return self.camera.width_px * self.samples

    @property
    def height(self) -> int:
        """Number of rows of texels."""
        return self.camera.height_px * self.samples

    @property
    def cells(self) -> tuple[LensProjection, ...]:
        """The only cell of this layout: the whole image."""
        return (self,)

    @property
    def viewport(self) -> tuple[int, int, int, int]:
        """Rectangle (x, y, width, height) of the whole image as OpenGL expects it."""
        return 0, 0, self.width, self.height

    @property
    def clip_from_mirror(self) -> Floats:
        """(3, 3) map from directions in the mirror frame to clip x, y and w.

        y grows downwards in the image: row 0 of the texture is the top.
        """
        forward, right, down = self.mirror_from_camera.T
        focal_x, focal_y = self._normalized_focal_lengths
        return np.stack((focal_x * right, focal_y * down, forward))

    @property
    def max_depth_ratio(self) -> float:
        """Largest ratio of a point's distance to the point's depth along the optical axis."""
        # The ratio is largest in the image's corners, where the tangents of both half angles add
        # up.
        focal_x, focal_y = self._normalized_focal_lengths
        return math.sqrt(1.0 + 1.0 / focal_x**2 + 1.0 / focal_y**2)

    @property
    def _normalized_focal_lengths(self) -> tuple[float, float]:
        """Focal length in units of half the image's width and of half the image's height."""
        focal = 2.0 * self.camera.focal_length_px
        return focal / self.camera.width_px, focal / self.camera.height_px


def make_lens_projection(
    camera: PerspectiveCamera,
    samples: int,
    mirror_from_camera: Floats | None = None,
    *,
    max_texels: int,
) -> LensProjection:
    """Projection of a perspective camera.

    Args:
        camera: Size and field of view of the image.
        samples: Samples along a pixel's side.
        mirror_from_camera: (3, 3) rotation of the camera; None for the mirror frame's own axes.
        max_texels: Largest side of a texture on this device.

    Raises:
        DomainError: The image with its samples exceeds `max_texels` a side.
    """
    rotation = np.eye(3) if mirror_from_camera is None else mirror_from_camera
    projection = LensProjection(camera, samples, rotation)
    if max(projection.width, projection.height) > max_texels:
        raise DomainError(
            f"{samples}^2 samples of {camera.width_px} x {camera.height_px} px are too many: this "
            f"OpenGL allows {max_texels} px a side"
        )
    return projection


@dataclass(frozen=True, slots=True)
class DepthRange:
    """Depths along a face's axis between which surfaces are drawn."""

    near_m: float
    """Depth of the near plane, metres."""
    far_m: float
    """Depth of the far plane, metres."""

    @property
    def clip_z_from_w(self) -> tuple[float, float]:
        """(a, b) of clip z = a w + b: -w on the near plane, +w on the far plane."""
        extent = self.far_m - self.near_m
        return (self.far_m + self.near_m) / extent, -2.0 * self.far_m * self.near_m / extent


class DepthRangeFinder:
    """Depth ranges for viewpoints in a static scene, in the scene's frame."""

    def __init__(self, clusters: TriangleClusters, corners: Floats) -> None:
        """Precompute a box and a plane of each triangle.

        Args:
            clusters: Triangle clusters with their boxes.
            corners: (n, 3, 3) corners in the scene's frame, in the order of the mesh.
        """
        self._clusters = clusters
        ordered = corners[clusters.order]
        self._low = ordered.min(axis=1)
        self._high = ordered.max(axis=1)
        cross = np.cross(ordered[:, 1] - ordered[:, 0], ordered[:, 2] - ordered[:, 0])
        # A degenerate triangle has no plane: its zero normal makes the plane's distance zero, so
        # the box alone bounds the triangle.
        length = np.linalg.norm(cross, axis=-1, keepdims=True)
        self._normals = cross / np.where(length > 0.0, length, 1.0)
        self._offsets = np.einsum("ni,ni->n", self._normals, ordered[:, 0])

    def find_range(
        self,
        viewpoint: Floats,
        *,
        max_depth_ratio: float,
        object_distances_m: tuple[float, float] = (math.inf, 0.0),
    ) -> DepthRange:
        """Depth range for faces at a viewpoint.

        Args:
            viewpoint: (3,) position in the scene's frame, metres.
            max_depth_ratio: Largest distance of a point one metre ahead, over all faces.
            object_distances_m: Least and greatest distance of dynamic objects.
        """
        # A point at distance d has a depth of at least d / max_depth_ratio, so distances beyond
        # this cutoff cannot move the near plane.
        nearest = min(
            self._min_distance(viewpoint, MAX_NEAR_M * max_depth_ratio), object_distances_m[0]
        )
        near = min(max(nearest / max_depth_ratio, _MIN_NEAR_M), MAX_NEAR_M)
        farthest = max(self._max_distance(viewpoint), object_distances_m[1])
        # Twice the near plane keeps the range valid in an empty scene, whose largest distance is
        # zero.
        return DepthRange(near, max(_FAR_MARGIN * farthest, 2.0 * near))

    def _max_distance(self, viewpoint: Floats) -> float:
        """Upper bound on the distance of any surface: the farthest corner of the scene's box."""
        if not len(self._offsets):
            return 0.0
        farthest = np.maximum(
            viewpoint - self._clusters.box_min.min(axis=0),
            self._clusters.box_max.max(axis=0) - viewpoint,
        )
        return math.hypot(*farthest)

    def _min_distance(self, viewpoint: Floats, cutoff_m: float) -> float:
        """Lower bound on the distance of any surface, at most `cutoff_m`.

        Only clusters whose box is closer than the cutoff are examined triangle by triangle.
        """
        close = np.flatnonzero(self._clusters.distances(viewpoint) < cutoff_m)
        offsets = self._clusters.offsets
        parts = (slice(offsets[cluster], offsets[cluster + 1]) for cluster in close)
        bounds = (
            min_distance_bound(
                self._low[part],
                self._high[part],
                self._normals[part],
                self._offsets[part],
                point=viewpoint,
            )
            for part in parts
        )
        return min(bounds, default=cutoff_m)


def min_distance_bound(
    low: Floats, high: Floats, normals: Floats, offsets: Floats, *, point: Floats
) -> float:
    """Lower bound on the distance from a point to the nearest of n triangles, n >= 1.

    No triangle is nearer than its box or its plane; the larger of the two is the bound.

    Args:
        low: (n, 3) least coordinates of the triangles.
        high: (n, 3) greatest coordinates.
        normals: (n, 3) unit normals of the triangles' planes.
        offsets: (n,) distances of the planes from the origin along the normals.
        point: (3,) position in the same frame.
    """
    outside = np.maximum(np.maximum(low - point, point - high), 0.0)
    to_box = np.sqrt(np.square(outside).sum(axis=-1))
    to_plane = np.abs(normals @ point - offsets)
    return float(np.maximum(to_box, to_plane).min())
