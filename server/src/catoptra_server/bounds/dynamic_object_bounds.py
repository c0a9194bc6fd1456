"""Distance and speed bounds of dynamic objects, by ring of the image.

An object is bounded by the boxes around a few dozen of its triangles each. Objects move from frame
to frame, so nothing but the boxes in the object's own frame is cached.
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.bounds.image_rings import ImageRings, box_distance_bounds
from catoptra_server.effects.scene_summary import NUM_RINGS
from catoptra_server.world.objects import DynamicObject, ObjectMesh
from catoptra_server.world.triangles import make_clusters

# A P2AT of 704 triangles is 22 boxes: 0.7 ms a frame and robot, most of that NumPy's overhead.
_TRIANGLES_PER_BOX = 32


@dataclass(frozen=True, slots=True, eq=False)
class ProximityBounds:
    """Bounds of all objects together, an element a ring."""

    min_distances_m: Floats
    """(NUM_RINGS,) no object is shown nearer; inf: none is shown."""
    max_object_rates_rad_s: Floats
    """(NUM_RINGS,) angular rate at which moving objects pass by, at most."""


class DynamicObjectBounds:
    """Bounds of objects, with the boxes of every mesh so far."""

    def __init__(self) -> None:
        self._boxes: dict[ObjectMesh, tuple[Floats, Floats]] = {}

    def bound(
        self,
        objects: tuple[DynamicObject, ...],
        viewpoint: Floats,
        axis_rotation: Floats,
        rings: ImageRings,
    ) -> ProximityBounds:
        """Bound the distances and angular rates of objects.

        Args:
            viewpoint: (3,) metres, world frame.
            axis_rotation: (3, 3) from the world to axes whose z is the mirror axis.
        """
        nearest, passing = np.full(NUM_RINGS, np.inf), np.zeros(NUM_RINGS)
        for dynamic_object in objects:
            bounds = self._ring_bounds(dynamic_object, viewpoint, axis_rotation, rings)
            nearest = np.minimum(nearest, bounds)
            speed_m_s = _max_speed_m_s(dynamic_object)
            # The viewpoint may lie in a box; a micrometre keeps the quotient finite.
            if speed_m_s > 0.0:
                passing = np.maximum(passing, speed_m_s / np.maximum(bounds, 1e-6))
        return ProximityBounds(nearest, passing)

    def _ring_bounds(
        self,
        dynamic_object: DynamicObject,
        viewpoint: Floats,
        axis_rotation: Floats,
        rings: ImageRings,
    ) -> Floats:
        centres, halves = self._mesh_boxes(dynamic_object.mesh)
        axes = axis_rotation @ dynamic_object.world_from_object.rotation
        centre = centres @ axes.T + axis_rotation @ (
            dynamic_object.world_from_object.translation - viewpoint
        )
        # A rotated box lies in the box of its rotated half axes: |R| h.
        half = halves @ np.abs(axes).T
        bounds: Floats = box_distance_bounds(centre - half, centre + half, rings).min(axis=0)
        return bounds

    def _mesh_boxes(self, mesh: ObjectMesh) -> tuple[Floats, Floats]:
        if mesh not in self._boxes:
            group = np.zeros(len(mesh), dtype=np.intp)
            clusters = make_clusters(mesh.corners, group, size=_TRIANGLES_PER_BOX)
            self._boxes[mesh] = (
                0.5 * (clusters.box_min + clusters.box_max),
                0.5 * (clusters.box_max - clusters.box_min),
            )
        return self._boxes[mesh]


def _max_speed_m_s(dynamic_object: DynamicObject) -> float:
    """Speed in the world that no point of an object exceeds: the bounding sphere's."""
    sphere_centre = dynamic_object.twist.at_offset(
        dynamic_object.centre - dynamic_object.world_from_object.translation
    )
    turning = (
        float(np.linalg.norm(dynamic_object.twist.angular_rad_s)) * dynamic_object.mesh.radius_m
    )
    return sphere_centre.speed_m_s + turning
