"""Dynamic objects: meshes at poses that change from frame to frame, such as other robots.

A mesh is built once for a class of robots, in the object's frame; an object adds pose and motion.
Objects have no textures: one albedo a triangle, lit by the same model as the scene (`shading`).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.scene.primitives import Patch, concatenate
from catoptra_server.scene.twist import AT_REST, Twist
from catoptra_server.scene.world_description import Material


@dataclass(frozen=True, slots=True, eq=False)
class ObjectMesh:
    """Triangles in an object's frame."""

    corners: Floats
    """(n, 3, 3) metres."""
    normals: Floats
    """(n, 3) unit, from the winding."""
    albedo: Floats
    """(n, 3) linear."""
    unlit: Bools
    """(n,)."""
    centre: Floats
    """(3,) centre of a bounding sphere."""
    radius_m: float
    """Radius of the bounding sphere."""
    half_size_m: Floats
    """(3,) half lengths of the bounding box about the same centre."""

    def __len__(self) -> int:
        """Number of triangles."""
        return len(self.corners)


@dataclass(frozen=True, slots=True, eq=False)
class DynamicObject:
    """Object at a pose; objects of one class share their mesh."""

    mesh: ObjectMesh
    world_from_object: Pose
    twist: Twist = AT_REST
    """Motion of the object's frame in the world, referred to the frame's origin."""
    name: str = ""
    """Name of the robot, for labels."""
    number: int = 0
    """Number of the robot among all that were ever spawned, from 1; 0: unknown."""

    @property
    def centre(self) -> Floats:
        """Centre of the bounding sphere, (3,) metres, world frame."""
        return self.world_from_object.transform_points(self.mesh.centre)

    def encloses(self, point: Floats) -> bool:
        """Whether a (3,) point of the world lies in the box around the object, in its own axes."""
        # The sphere first: most objects are far from most points.
        if float(np.linalg.norm(point - self.centre)) > self.mesh.radius_m:
            return False
        offset = self.world_from_object.inverse().transform_points(point) - self.mesh.centre
        return bool((np.abs(offset) <= self.mesh.half_size_m).all())


@dataclass(frozen=True, slots=True, eq=False)
class WorldFacets:
    """Facets of an object in the world, as `shading.LitFacets`."""

    normals: Floats
    """(n, 3) unit, world frame."""
    albedo: Floats
    """(n, 3) linear."""
    unlit: Bools
    """(n,)."""


def build_object_mesh(parts: Iterable[tuple[Patch, Material]]) -> ObjectMesh:
    """Build the mesh of patches with their materials, in the object's frame; at least one patch."""
    parts = tuple(parts)
    assert all(material.texture is None for _, material in parts), (
        "dynamic objects have no textures"
    )
    counts = [len(patch.corners) for patch, _ in parts]
    corners = concatenate([patch for patch, _ in parts]).corners
    # Unit normals from the winding, as in scene_mesh; a degenerate triangle keeps a zero normal.
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=-1, keepdims=True)
    # The box's centre: not that of the smallest sphere, but a closed form.
    centre: Floats = 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1)))
    mesh = ObjectMesh(
        corners=corners,
        normals=cross / np.where(length > 0.0, length, 1.0),
        albedo=np.repeat([material.albedo for _, material in parts], counts, axis=0),
        unlit=np.repeat([material.unlit for _, material in parts], counts),
        centre=centre,
        radius_m=float(np.linalg.norm(corners - centre, axis=-1).max()),
        half_size_m=np.abs(corners - centre).max(axis=(0, 1)),
    )
    shared = (mesh.corners, mesh.normals, mesh.albedo, mesh.unlit, mesh.centre, mesh.half_size_m)
    for array in shared:
        # Shared by all objects of a class and by caches that are keyed by the mesh.
        array.setflags(write=False)
    return mesh


def world_facets(dynamic_object: DynamicObject) -> WorldFacets:
    """Facets of an object at its pose."""
    mesh = dynamic_object.mesh
    return WorldFacets(
        dynamic_object.world_from_object.rotate_directions(mesh.normals), mesh.albedo, mesh.unlit
    )
