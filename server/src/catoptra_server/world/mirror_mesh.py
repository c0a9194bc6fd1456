"""Mirror mesh of the paper's Section 2.2: S sectors x R rings of polygons on the surface of Eq. 1.

Rings are equal in image radius, sectors in azimuth. Ring 0 consists of triangles; every other
polygon is a quadrilateral split in two, so the mesh has S (2R - 1) triangles for N = S R polygons.

Each corner carries the direction that is looked up in the cube. Between corners the direction is
interpolated linearly over the flat facet: the source of a coarse mesh's error. UV and position
interpolation differ only in the directions' lengths, so both renderers draw these meshes, and the
paper's comparison needs no OpenGL. Source: Schmits & Visser 2009, Section 2.2.
"""

from __future__ import annotations

import math
from enum import Enum

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, face_from_direction
from catoptra_protocol.optics.elementary import cos, einsum, ln, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass


class Interpolation(Enum):
    """Quantity interpolated over a facet."""

    UV = "uv"
    """Texture coordinates in the plane of one cube face a polygon: the paper's UV-mapped mesh."""
    POSITION = "position"
    """Position on the facet seen from the viewpoint, looked up in the cube per pixel."""


@dataclass(frozen=True, slots=True)
class Tessellation:
    """Division of the mirror into N = sectors * rings polygons."""

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
        """Number of polygons, N."""
        return self.sectors * self.rings


def tessellation_from_polygon_count(
    num_polygons: int, interpolation: Interpolation = Interpolation.UV
) -> Tessellation:
    """Tessellation of a polygon count: square for 4^n, as in the paper's 16 to 4096.

    Any other count is factored as near to sectors = 4 rings as possible.
    """
    # The paper's meshes, 16 to 4096 polygons, are square; smaller counts are factored below.
    root = math.isqrt(num_polygons)
    if root * root == num_polygons and root >= 4:
        return Tessellation(root, root, interpolation)
    rings = [r for r in range(1, num_polygons // 3 + 1) if num_polygons % r == 0]
    best = min(rings, key=lambda r: abs(ln(num_polygons / (4.0 * r * r))), default=0)
    return Tessellation(num_polygons // best if best else num_polygons, best, interpolation)


@dataclass(frozen=True, slots=True, eq=False)
class MirrorMesh:
    """Triangles of a mirror mesh, in the mirror frame."""

    corners: Floats
    """(n, 3, 3) metres."""
    directions: Floats
    """(n, 3, 3) directions looked up at the corners; not unit, since their lengths take part in the
    interpolation."""


def build_mirror_mesh(camera: OmniCamera, tessellation: Tessellation) -> MirrorMesh:
    """Build the triangles of the mirror up to the camera's rim."""
    polygons = mirror_polygons(camera, tessellation)
    corners, polygon = _split_into_triangles(polygons, tessellation)
    directions = corners
    if tessellation.interpolation is Interpolation.UV:
        # The face in the direction of each polygon's centre.
        faces = face_from_direction(polygons.sum(axis=1))
        directions = _project_to_face_planes(corners, faces[polygon])
    corners.setflags(write=False)
    directions.setflags(write=False)
    return MirrorMesh(corners, directions)


def mirror_polygons(camera: OmniCamera, tessellation: Tessellation) -> Floats:
    """(rings * sectors, 4, 3) corners of the polygons, ring by ring from the centre.

    In the first ring, made of triangles, the first two corners coincide.
    """
    points = _ring_vertices(camera, tessellation)
    # The next sector's vertex: sectors wrap around, rings do not.
    a, b = points[:-1], np.roll(points[:-1], -1, axis=1)
    d, c = points[1:], np.roll(points[1:], -1, axis=1)
    return np.stack((a, b, c, d), axis=2).reshape(-1, 4, 3)


def _ring_vertices(camera: OmniCamera, tessellation: Tessellation) -> Floats:
    """(rings + 1, sectors, 3) vertices; ring 0 is the vertex of the mirror, S times."""
    ratio = np.linspace(0.0, 1.0, tessellation.rings + 1) * camera.rim_radius_px / camera.scale_px
    r, z = camera.mirror.surface_point(camera.projection.t_from_radius_ratio(ratio))
    # A border at 45 degrees: with 8, 16, ... sectors no polygon then crosses an edge of the side
    # faces.
    azimuth = (
        0.25 * math.pi + 2.0 * math.pi * np.arange(tessellation.sectors) / tessellation.sectors
    )
    x, y = np.outer(r, cos(azimuth)), np.outer(r, sin(azimuth))
    return np.stack((x, y, np.broadcast_to(z[:, None], x.shape)), axis=-1)


def _split_into_triangles(
    polygons: Floats, tessellation: Tessellation
) -> tuple[Floats, np.ndarray[tuple[int], np.dtype[np.intp]]]:
    """(n, 3, 3) corners and the (n,) polygon (ring * S + sector) of each triangle."""
    outer, inner = polygons[:, (0, 2, 3)], polygons[tessellation.sectors :, (0, 1, 2)]
    polygon = np.arange(tessellation.num_polygons)
    return np.concatenate((outer, inner)), np.concatenate(
        (polygon, polygon[tessellation.sectors :])
    )


def _project_to_face_planes(
    corners: Floats, face: np.ndarray[tuple[int], np.dtype[np.intp]]
) -> Floats:
    """Project corners onto the planes of their polygons' faces: (1, s, t) of the face.

    Linear interpolation there is the linear interpolation of texture coordinates. A corner beside
    or behind the face, which only meshes of a few polygons have, keeps a tenth of its distance, so
    that the coordinates are large but finite.
    """
    forward = einsum("nci,ni->nc", corners, MIRROR_FROM_FACE_ROTATIONS[face][:, :, 0])
    norm = np.linalg.norm(corners, axis=-1)
    on_planes: Floats = corners / np.maximum(forward, 0.1 * norm)[..., None]
    return on_planes
