"""What moves through a world and is seen there: the triangles of a body, and where it stands.

A body's triangles are built once a class, in the body's frame; its pose is all that changes. Bodies
have no textures: their light is one albedo a triangle, lit by the same model as the scene's.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.scene.primitives import Patch, concatenate
from catoptra_server.scene.twist import AT_REST, Twist
from catoptra_server.scene.world_description import Material


@dataclass(frozen=True, slots=True, eq=False)
class ObjectMesh:
    """Triangles in a body's frame, and a sphere around them.

    corners: (n, 3, 3) metres. normals: (n, 3) unit, from the winding. albedo: (n, 3) linear.
    unlit: (n,). centre: (3,) of the sphere, radius_m its radius.
    """

    corners: Floats
    normals: Floats
    albedo: Floats
    unlit: Bools
    centre: Floats
    radius_m: float

    def __len__(self) -> int:
        """Return the number of triangles."""
        return len(self.corners)


@dataclass(frozen=True, slots=True, eq=False)
class DynamicObject:
    """A body at its place. Bodies of one class share their mesh.

    twist: of the body's frame, told at its origin in the world's axes.
    """

    mesh: ObjectMesh
    world_from_object: Pose
    twist: Twist = AT_REST

    @property
    def centre(self) -> Floats:
        """Return the middle of the sphere around it, (3,) metres, world frame."""
        return self.world_from_object.transform_points(self.mesh.centre)


@dataclass(frozen=True, slots=True, eq=False)
class WorldFacets:
    """What light falls on: (n, 3) normals in the world frame, (n, 3) albedo, (n,) unlit."""

    normals: Floats
    albedo: Floats
    unlit: Bools


def build_object_mesh(parts: Iterable[tuple[Patch, Material]]) -> ObjectMesh:
    """Return the mesh of patches, in the body's frame, and their materials; at least one."""
    parts = tuple(parts)
    assert all(material.texture is None for _, material in parts), "bodies have no textures"
    counts = [len(patch.corners) for patch, _ in parts]
    corners = concatenate([patch for patch, _ in parts]).corners
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=-1, keepdims=True)
    centre: Floats = 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1)))
    mesh = ObjectMesh(
        corners=corners,
        normals=cross / np.where(length > 0.0, length, 1.0),
        albedo=np.repeat([material.albedo for _, material in parts], counts, axis=0),
        unlit=np.repeat([material.unlit for _, material in parts], counts),
        centre=centre,
        radius_m=float(np.linalg.norm(corners - centre, axis=-1).max()),
    )
    for array in (mesh.corners, mesh.normals, mesh.albedo, mesh.unlit, mesh.centre):
        array.setflags(write=False)
    return mesh


def world_facets(dynamic_object: DynamicObject) -> WorldFacets:
    """Return what light falls on: the mesh's facets, turned as the body is."""
    mesh = dynamic_object.mesh
    return WorldFacets(
        dynamic_object.world_from_object.rotate_directions(mesh.normals), mesh.albedo, mesh.unlit
    )
