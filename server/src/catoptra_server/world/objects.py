"""Dynamic objects, such as robots: meshes at poses that change from frame to frame, and boxes.

A mesh is built once for a class of robots, in the object's frame; an object adds pose and motion.
Objects have no textures: one albedo a triangle, lit by the same model as the scene (`shading`).

To each other's sensors robots are oriented boxes, intersected with rays in closed form: 0.6 ms a
cycle of the P2AT among seven others (tests/measurements/sensor_times.py).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.shapes import Patch, concatenate
from catoptra_server.world.world_description import AT_REST, Material, Twist


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

    def with_pose(self, world_from_object: Pose) -> DynamicObject:
        """The same object at another pose; itself at the pose that it has."""
        if world_from_object is self.world_from_object:
            return self
        return DynamicObject(self.mesh, world_from_object, self.twist, self.name, self.number)

    def encloses(self, point: Floats) -> bool:
        """Whether a (3,) point of the world lies in the box around the object, in its own axes."""
        # The sphere first: most objects are far from most points.
        if math.dist(point.tolist(), self.centre.tolist()) > self.mesh.radius_m:
            return False
        offset = self.world_from_object.inverse().transform_points(point) - self.mesh.centre
        return bool((np.abs(offset) <= self.mesh.half_size_m).all())


@dataclass(frozen=True, slots=True, eq=False)
class _WorldFacets:
    """Facets of an object in the world, as `shading.LitFacets`."""

    normals: Floats
    """(n, 3) unit, world frame."""
    albedo: Floats
    """(n, 3) linear."""
    unlit: Bools
    """(n,)."""


def world_facets(dynamic_object: DynamicObject) -> _WorldFacets:
    """Facets of an object at its pose."""
    mesh = dynamic_object.mesh
    return _WorldFacets(
        dynamic_object.world_from_object.rotate_directions(mesh.normals), mesh.albedo, mesh.unlit
    )


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
    # The box's centre, a closed form; the smallest sphere has another.
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


class OrientedBox(NamedTuple):
    """Box centred on its pose."""

    world_from_box: Pose
    size_m: tuple[float, float, float]


def box_distances(boxes: Sequence[OrientedBox], origins: Floats, directions: Floats) -> Floats:
    """Distance along rays to the nearest box, world frame.

    Args:
        origins: (n, 3) points.
        directions: (n, 3) unit directions.

    Returns:
        (n,) metres; inf for a ray that misses, 0 for an origin inside a box.
    """
    if not boxes:
        return np.full(len(directions), np.inf)
    nearest: Floats = _distances_by_box(boxes, origins, directions).min(axis=0)
    return nearest


def closest_box_hits(
    boxes: Sequence[OrientedBox], origins: Floats, directions: Floats
) -> tuple[Floats, Floats]:
    """Distance as by `box_distances`, and the (n, 3) unit normals at the hits; 0 for a miss.

    From inside a box the normal faces the ray.
    """
    normals = np.zeros(directions.shape)
    if not boxes:
        return np.full(len(directions), np.inf), normals
    distances = _distances_by_box(boxes, origins, directions)
    nearest: Floats = distances.min(axis=0)
    # Box by box: few boxes are the nearest one of any ray.
    nearest_box = np.where(np.isfinite(nearest), distances.argmin(axis=0), -1)
    for index in np.unique(nearest_box[nearest_box >= 0]):
        rays = nearest_box == index
        normals[rays] = _box_normals(boxes[index], origins[rays], directions[rays])
    return nearest, normals


# Replaces a direction component of 0: the slab is then crossed at +-1e200 times a length, behind
# every distance and still finite.
_MIN_DIRECTION_COMPONENT = 1e-200


def _distances_by_box(boxes: Sequence[OrientedBox], origins: Floats, directions: Floats) -> Floats:
    """(k, n) distances along n rays to k boxes; see `box_distances`."""
    rotations = np.stack([box.world_from_box.rotation for box in boxes])
    centres = np.stack([box.world_from_box.translation for box in boxes])
    half = 0.5 * np.array([box.size_m for box in boxes]).T[..., None]
    # (3, k, n), components first, all boxes at once: 0.2 ms for 400 rays and 7 boxes, 0.5 ms box by
    # box; measured in tests/measurements/sensor_times.py.
    start = (
        _components_in_boxes(rotations, origins)
        - np.einsum("ki,kij->jk", centres, rotations)[..., None]
    )
    along = _components_in_boxes(rotations, directions)
    return _slab_hits(
        start,
        np.where(np.abs(along) < _MIN_DIRECTION_COMPONENT, _MIN_DIRECTION_COMPONENT, along),
        half,
    )


def _box_normals(box: OrientedBox, origins: Floats, directions: Floats) -> Floats:
    """(n, 3) normals of the faces through which rays enter a box."""
    rotation = box.world_from_box.rotation
    start = (origins - box.world_from_box.translation) @ rotation
    along = directions @ rotation
    along = np.where(np.abs(along) < _MIN_DIRECTION_COMPONENT, _MIN_DIRECTION_COMPONENT, along)
    enter = (-np.copysign(0.5 * np.array(box.size_m), along) - start) / along
    face = enter.argmax(axis=1)
    rows = np.arange(len(directions))
    normals: Floats = -np.sign(along[rows, face])[:, None] * rotation.T[face]
    return np.where(enter[rows, face, None] > 0.0, normals, -directions)


def _components_in_boxes(rotations: Floats, vectors: Floats) -> Floats:
    """(3, k, n) components of (n, 3) vectors along the axes of k boxes."""
    count = len(rotations)
    columns = rotations.transpose(1, 2, 0).reshape(3, 3 * count)
    return np.ascontiguousarray((vectors @ columns).T).reshape(3, count, -1)


def _slab_hits(start: Floats, along: Floats, half: Floats) -> Floats:
    """(k, n) distances to k boxes, each the intersection of three slabs."""
    first, second = (-half - start) / along, (half - start) / along
    enter = np.minimum(first, second).max(axis=0)
    leave = np.maximum(first, second).min(axis=0)
    is_hit: Bools = (enter <= leave) & (leave >= 0.0)
    return np.where(is_hit, np.maximum(enter, 0.0), np.inf)
