"""The rays of the paper's mirror mesh, in float64: the reference for raster's UV-mapped mesh.

A camera ray from the pinhole hits a flat facet; the looked-up direction is interpolated between the
facet's corners at that point. Each corner carries the direction that is looked up, and UV and
position interpolation differ only in its length. So the paper's comparison needs no OpenGL. Embree
finds the facet, the interpolation is done here in float64.
"""

from __future__ import annotations

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_server.world.mirror_mesh import MirrorMesh, Tessellation, build_mirror_mesh


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
    mesh = build_mirror_mesh(camera, tessellation)
    rays = _camera_rays(camera, pixel).reshape(-1, 3)
    pinhole = np.array([0.0, 0.0, camera.mirror.pinhole_distance_m])
    triangle = _intersect_facets(mesh, pinhole, rays)
    valid = triangle >= 0
    looked_up = np.tile([0.0, 0.0, 1.0], (len(rays), 1))
    corners, directions = mesh.corners[triangle[valid]], mesh.directions[triangle[valid]]
    weights = _barycentric_weights(corners - pinhole, rays[valid])
    looked_up[valid] = np.einsum("nc,nci->ni", weights, directions)
    # Normalized last, as a GPU does with interpolated attributes: lengths at the corners matter:
    # the difference between UV and position interpolation.
    looked_up /= np.linalg.norm(looked_up, axis=-1, keepdims=True)
    return looked_up.reshape(*pixel.shape[:-1], 3), valid.reshape(pixel.shape[:-1])


def _camera_rays(camera: OmniCamera, pixel: Floats) -> Floats:
    """(..., 3) directions from the pinhole to the exact mirror's point behind each pixel.

    Outside the rim the ray misses the mirror; any missing direction will do: away from the mirror.
    """
    direction, valid = direction_from_pixel(camera, pixel)
    t = np.linalg.norm(direction[..., :2], axis=-1) / (1.0 + direction[..., 2])
    r, z = camera.mirror.surface_point(np.where(valid, t, 0.0))
    azimuth = np.arctan2(direction[..., 1], direction[..., 0])
    drop = camera.mirror.pinhole_distance_m - z
    rays = np.stack((r * np.cos(azimuth), r * np.sin(azimuth), -drop), axis=-1)
    return np.where(valid[..., None], rays, (0.0, 0.0, 1.0))


def _intersect_facets(mesh: MirrorMesh, pinhole: Floats, rays: Floats) -> np.ndarray[tuple[int]]:
    """(n,) index of the triangle that each ray from the pinhole hits, -1 for none."""
    # Robust mode is watertight: no ray slips between facets that share an edge.
    scene = rtcore_scene.EmbreeScene(robust=True)
    TriangleMesh(scene, (mesh.corners - pinhole).astype(np.float32))
    origins = np.zeros((len(rays), 3), dtype=np.float32)
    hits: np.ndarray[tuple[int]] = scene.run(origins, rays.astype(np.float32))
    return hits


def _barycentric_weights(corners: Floats, rays: Floats) -> Floats:
    """(n, 3) barycentric weights at which (n, 3) rays from the origin hit (n, 3, 3) triangles.

    Each weight is the signed volume of the ray with the opposite edge; all three share their
    divisor.
    """
    volumes = np.stack(
        [
            np.einsum("ni,ni->n", rays, np.cross(corners[:, (i + 1) % 3], corners[:, (i + 2) % 3]))
            for i in range(3)
        ],
        axis=-1,
    )
    weights: Floats = volumes / volumes.sum(axis=-1, keepdims=True)
    return weights
