"""The polygon mirror of the paper's Section 2.2: S sectors x R rings on the surface of Eq. 1.

Rings are equal in image radius, sectors in azimuth, sector borders on the cube's edges (azimuth 45
degrees and so on when S is a multiple of 8). Ring 0 is made of triangles; every other polygon is a
quadrilateral split in two, so the mesh has S (2R - 1) triangles for N = S R polygons.

Each corner carries the direction that is looked up in the cube. Between corners it is interpolated
linearly over the flat facet: that is where a coarse mirror goes wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, face_from_direction
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera


class Interpolation(Enum):
    """What is interpolated over a facet.

    UV: texture coordinates in the plane of one cube face a polygon, as the paper's UV-mapped mesh.
    POSITION: the facet's position seen from the viewpoint, looked up in the cube per pixel.
    """

    UV = "uv"
    POSITION = "position"


@dataclass(frozen=True, slots=True)
class Tessellation:
    """How the mirror is cut: N = sectors * rings polygons."""

    sectors: int
    rings: int
    interpolation: Interpolation = Interpolation.UV

    def __post_init__(self) -> None:
        if self.sectors < 3 or self.rings < 1:
            raise DomainError(
                f"a mirror of {self.sectors} sectors x {self.rings} rings is no surface: "
                "it needs at least 3 x 1"
            )

    @property
    def num_polygons(self) -> int:
        """Return N."""
        return self.sectors * self.rings


def tessellation_from_polygon_count(
    num_polygons: int, interpolation: Interpolation = Interpolation.UV
) -> Tessellation:
    """Return the split of a polygon count: the square one for 4^n, as in the paper's 16 to 4096.

    Any other count is factored as near to sectors = 4 rings as it allows.
    """
    root = math.isqrt(num_polygons)
    if root * root == num_polygons and root >= 4:
        return Tessellation(root, root, interpolation)
    rings = [r for r in range(1, num_polygons // 3 + 1) if num_polygons % r == 0]
    best = min(rings, key=lambda r: abs(math.log(num_polygons / (4.0 * r * r))), default=0)
    return Tessellation(num_polygons // best if best else num_polygons, best, interpolation)


@dataclass(frozen=True, slots=True, eq=False)
class MirrorMesh:
    """A polygon mirror: corners (n, 3, 3) in metres, looked-up directions (n, 3, 3), mirror frame.

    Directions are not unit: their length is part of the interpolation.
    """

    corners: Floats
    directions: Floats


def build_mirror_mesh(camera: OmniCamera, tessellation: Tessellation) -> MirrorMesh:
    """Return the triangles of the mirror that fills the camera's rim."""
    polygons = mirror_polygons(camera, tessellation)
    corners, polygon = _split_into_triangles(polygons, tessellation)
    directions = corners if tessellation.interpolation is Interpolation.POSITION else None
    if directions is None:
        directions = _project_to_face_planes(corners, _polygon_faces(polygons)[polygon])
    corners.setflags(write=False)
    directions.setflags(write=False)
    return MirrorMesh(corners, directions)


def mirror_polygons(camera: OmniCamera, tessellation: Tessellation) -> Floats:
    """Return the (rings * sectors, 4, 3) corners of the polygons, ring by ring from the middle.

    In the first ring, made of triangles, the first two corners coincide.
    """
    points = _ring_vertices(camera, tessellation)
    a, b = points[:-1], np.roll(points[:-1], -1, axis=1)
    d, c = points[1:], np.roll(points[1:], -1, axis=1)
    return np.stack((a, b, c, d), axis=2).reshape(-1, 4, 3)


def _ring_vertices(camera: OmniCamera, tessellation: Tessellation) -> Floats:
    """Return the (rings + 1, sectors, 3) vertices; ring 0 is the vertex of the mirror, S times."""
    ratio = (
        np.linspace(0.0, 1.0, tessellation.rings + 1)
        * camera.rim_radius_px
        / camera.horizon_radius_px
    )
    r, z = camera.mirror.surface_point(camera.mirror.t_from_radius_ratio(ratio))
    # A border at 45 degrees, so that with 8, 16, ... sectors no polygon crosses the side faces'
    # edges.
    azimuth = (
        0.25 * math.pi + 2.0 * math.pi * np.arange(tessellation.sectors) / tessellation.sectors
    )
    x, y = np.outer(r, np.cos(azimuth)), np.outer(r, np.sin(azimuth))
    return np.stack((x, y, np.broadcast_to(z[:, None], x.shape)), axis=-1)


def _split_into_triangles(
    polygons: Floats, tessellation: Tessellation
) -> tuple[Floats, np.ndarray[tuple[int], np.dtype[np.intp]]]:
    """Return (n, 3, 3) corners and the (n,) polygon (ring * S + sector) of each triangle."""
    outer, inner = polygons[:, (0, 2, 3)], polygons[tessellation.sectors :, (0, 1, 2)]
    polygon = np.arange(tessellation.num_polygons)
    return np.concatenate((outer, inner)), np.concatenate(
        (polygon, polygon[tessellation.sectors :])
    )


def _polygon_faces(polygons: Floats) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Return the (R * S) cube face of each polygon: the one that its middle looks into."""
    return face_from_direction(polygons.sum(axis=1))


def _project_to_face_planes(
    corners: Floats, face: np.ndarray[tuple[int], np.dtype[np.intp]]
) -> Floats:
    """Return the corners pushed onto the planes of their polygons' faces: (1, s, t) of the face.

    Linear interpolation there is the linear interpolation of texture coordinates. A corner that the
    face does not see in front of it (only on meshes of a few polygons) keeps a distance of a tenth,
    so that its coordinates are large but finite.
    """
    forward = np.einsum("nci,ni->nc", corners, MIRROR_FROM_FACE_ROTATIONS[face][:, :, 0])
    norm = np.linalg.norm(corners, axis=-1)
    on_planes: Floats = corners / np.maximum(forward, 0.1 * norm)[..., None]
    return on_planes
