"""The rays of the paper's mirror mesh, in float64: the reference for raster's UV-mapped mesh.

A camera ray from the pinhole hits a flat facet; the looked-up direction is interpolated between the
facet's corners at that point. Each corner carries the direction that is looked up, and UV and
position interpolation differ only in its length. So the paper's comparison needs no OpenGL.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_server.render.trace.reference.triangle_search import TriangleSearch
from catoptra_server.world.mirror_mesh import Tessellation, build_mirror_mesh


def mirror_mesh_directions(
    camera: OmniCamera, tessellation: Tessellation, pixel: Floats
) -> tuple[Floats, Bools]:
    """Directions that a mirror mesh reflects into pixels, and their validity.

    Args:
        camera: Camera model that the mesh approximates.
        tessellation: Rings and sectors of the mesh.
        pixel: (..., 2) pixel positions.

    Returns:
        (..., 3) unit directions in the mirror frame, +z where invalid, and (...,) validity: False
        beside the polygons, which do not reach the rim circle.

    Raises:
        DomainError: The capture camera is orthographic.
    """
    if not np.isfinite(camera.mirror.pinhole_distance_m):
        raise DomainError("a mirror mesh needs a capture camera with a pinhole")
    rays = _camera_rays(camera, pixel).reshape(-1, 3)
    interpolation, facets = _build_facets(camera, tessellation)
    _, triangle, _ = facets.first_hits(np.zeros(rays.shape), rays)
    valid = triangle >= 0
    looked_up = np.einsum("nij,nj->ni", interpolation[triangle], rays)
    looked_up[~valid] = 0.0, 0.0, 1.0
    # Normalized last, as a GPU does with interpolated attributes: lengths at the corners matter:
    # the difference between UV and position interpolation.
    looked_up /= np.sqrt(np.einsum("ni,ni->n", looked_up, looked_up))[:, None]
    return looked_up.reshape(*pixel.shape[:-1], 3), valid.reshape(pixel.shape[:-1])


def _camera_rays(camera: OmniCamera, pixel: Floats) -> Floats:
    """(..., 3) directions from the pinhole to the exact mirror's point behind each pixel.

    Outside the rim the ray misses the mirror; any missing direction will do: away from the mirror.
    """
    direction, valid = direction_from_pixel(camera, pixel)
    rho = np.hypot(direction[..., 0], direction[..., 1])
    r, z = camera.mirror.surface_point(np.where(valid, rho / (1.0 + direction[..., 2]), 0.0))
    level = direction[..., :2] * (r / np.where(rho > 0.0, rho, 1.0))[..., None]
    drop = z - camera.mirror.pinhole_distance_m
    rays = np.concatenate((level, drop[..., None]), axis=-1)
    return np.where(valid[..., None], rays, (0.0, 0.0, 1.0))


# Once for all batches of a view, where it took half of their time.
@lru_cache(maxsize=1)
def _build_facets(camera: OmniCamera, tessellation: Tessellation) -> tuple[Floats, TriangleSearch]:
    """(n, 3, 3) matrices from a ray to a multiple of the direction interpolated on each triangle
    that it hits, and the triangles themselves, as the pinhole at the origin sees them.
    """
    mesh = build_mirror_mesh(camera, tessellation)
    corners = mesh.corners - (0.0, 0.0, camera.mirror.pinhole_distance_m)
    # A ray is a multiple of the corners' sum by barycentric weights.
    interpolation = np.linalg.solve(corners, mesh.directions).swapaxes(-1, -2)
    return interpolation.astype(np.float64), TriangleSearch(corners)
