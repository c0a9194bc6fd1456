"""The rays of the paper's mirror mesh, in float64: the reference for raster's UV-mapped mesh.

A camera ray from the pinhole hits a flat facet; the looked-up direction is interpolated between the
facet's corners at that point. Each corner carries the direction that is looked up, and UV and
position interpolation differ only in its length. So the paper's comparison needs no OpenGL. The
facet follows from the pixel's sector and ring, without a search among triangles.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import arctan2, cos, dot, einsum, hypot, sin, solve_linear
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
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
    corners, interpolation = _build_facets(camera, tessellation)
    facet, valid = _find_facets(corners, tessellation, rays)
    looked_up = einsum("nij,nj->ni", interpolation[facet], rays)
    looked_up[~valid] = 0.0, 0.0, 1.0
    # Normalized last, as a GPU does with interpolated attributes: lengths at the corners matter:
    # the difference between UV and position interpolation.
    looked_up /= np.sqrt(dot(looked_up, looked_up))[:, None]
    return looked_up.reshape(*pixel.shape[:-1], 3), valid.reshape(pixel.shape[:-1])


def _camera_rays(camera: OmniCamera, pixel: Floats) -> Floats:
    """(..., 3) directions from the pinhole to the exact mirror's point behind each pixel.

    Outside the rim the ray misses the mirror; any missing direction will do: away from the mirror.
    """
    direction, valid = direction_from_pixel(camera, pixel)
    rho = hypot(direction[..., 0], direction[..., 1])
    r, z = camera.mirror.surface_point(np.where(valid, rho / (1.0 + direction[..., 2]), 0.0))
    level = direction[..., :2] * (r / np.where(rho > 0.0, rho, 1.0))[..., None]
    drop = z - camera.mirror.pinhole_distance_m
    rays = np.concatenate((level, drop[..., None]), axis=-1)
    return np.where(valid[..., None], rays, (0.0, 0.0, 1.0))


# Once for all batches of a view, where it took half of their time.
@lru_cache(maxsize=1)
def _build_facets(camera: OmniCamera, tessellation: Tessellation) -> tuple[Floats, Floats]:
    """(n, 3, 3) corners of the triangles, relative to the pinhole, and (n, 3, 3) matrices from a
    ray to a multiple of the direction interpolated on each triangle that it hits.
    """
    mesh = build_mirror_mesh(camera, tessellation)
    corners = mesh.corners - (0.0, 0.0, camera.mirror.pinhole_distance_m)
    # A ray is a multiple of the corners' sum by barycentric weights.
    interpolation = solve_linear(corners, mesh.directions).swapaxes(-1, -2)
    return corners, interpolation


def _find_facets(
    corners: Floats, tessellation: Tessellation, rays: Floats
) -> tuple[npt.NDArray[np.intp], Bools]:
    """(n,) triangles that (n, 3) rays from the pinhole hit, and whether they hit any.

    The pinhole lies on the mirror's axis: it sees sectors as equal angles, and rings as similar
    regular polygons.
    """
    sectors, num_polygons = tessellation.sectors, tessellation.num_polygons
    # In the plane one unit below the pinhole: each polygon's corners a, c and d.
    a, c, d = np.swapaxes(corners[:num_polygons, :, :2] / -corners[:num_polygons, :, 2:], 0, 1)
    points = rays[:, :2] / np.abs(rays[:, 2:])
    start_rad, angle_rad = float(arctan2(d[0, 1], d[0, 0])), 2.0 * math.pi / sectors
    turn = (arctan2(points[:, 1], points[:, 0]) - start_rad) / angle_rad
    sector = np.floor(turn).astype(np.intp) % sectors
    # A polygon's side is perpendicular to the middle of its sector.
    middle_rad = start_rad + (sector.astype(np.float64) + 0.5) * angle_rad
    along = points[:, 0] * cos(middle_rad) + points[:, 1] * sin(middle_rad)
    radii = hypot(*d[::sectors].T) * cos(0.5 * angle_rad)
    ring = np.searchsorted(radii, along)
    valid = (ring < tessellation.rings) & (rays[:, 2] < 0.0)
    polygon = np.where(valid, ring * sectors + sector, 0)
    # Beyond the diagonal from a to c, except in ring 0 of triangles.
    across, beyond = c[polygon] - a[polygon], points - a[polygon]
    is_second = across[:, 0] * beyond[:, 1] > across[:, 1] * beyond[:, 0]
    is_second &= polygon >= sectors
    return polygon + np.where(is_second, num_polygons - sectors, 0), valid
