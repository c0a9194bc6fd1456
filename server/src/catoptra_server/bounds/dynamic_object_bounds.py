"""How near bodies come in each ring of the image, and how fast those that move pass by.

Bodies are asked by the boxes around a few dozen of their triangles each: they move from frame to
frame, so that nothing of the answer can be kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.bounds.image_rings import ImageRings, box_distance_bounds
from catoptra_server.effects.scene_summary import NUM_RINGS
from catoptra_server.scene.dynamic_object import DynamicObject, ObjectMesh
from catoptra_server.scene.triangle_clusters import make_clusters

_TRIANGLES_PER_BOX = 32


@dataclass(frozen=True, slots=True, eq=False)
class ProximityBounds:
    """(RINGS,) of each: distances within which no body is shown, and the rates of passing by."""

    min_distances_m: Floats
    max_object_rates_rad_s: Floats


class DynamicObjectBounds:
    """The boxes of all meshes that bodies had so far, in their frames."""

    def __init__(self) -> None:
        self._boxes: dict[ObjectMesh, tuple[Floats, Floats]] = {}

    def bound(
        self,
        objects: tuple[DynamicObject, ...],
        viewpoint: Floats,
        axis_rotation: Floats,
        rings: ImageRings,
    ) -> ProximityBounds:
        """Return what bodies are to a (3,) viewpoint; turn: (3, 3) to axes with the mirror's z."""
        nearest, passing = np.full(NUM_RINGS, np.inf), np.zeros(NUM_RINGS)
        for body in objects:
            bounds = self._ring_bounds(body, viewpoint, axis_rotation, rings)
            nearest = np.minimum(nearest, bounds)
            speed_m_s = _max_speed_m_s(body)
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
        middles, halves = self._mesh_boxes(dynamic_object.mesh)
        axes = axis_rotation @ dynamic_object.world_from_object.rotation
        middle = middles @ axes.T + axis_rotation @ (
            dynamic_object.world_from_object.translation - viewpoint
        )
        half = halves @ np.abs(axes).T
        bounds: Floats = box_distance_bounds(middle - half, middle + half, rings).min(axis=0)
        return bounds

    def _mesh_boxes(self, mesh: ObjectMesh) -> tuple[Floats, Floats]:
        if mesh not in self._boxes:
            group = np.zeros(len(mesh), dtype=np.intp)
            chunks = make_clusters(mesh.corners, group, size=_TRIANGLES_PER_BOX)
            self._boxes[mesh] = (
                0.5 * (chunks.box_min + chunks.box_max),
                0.5 * (chunks.box_max - chunks.box_min),
            )
        return self._boxes[mesh]


def _max_speed_m_s(dynamic_object: DynamicObject) -> float:
    """Return a speed that no point of a body exceeds in the world: that of the sphere around it."""
    middle = dynamic_object.twist.at_offset(
        dynamic_object.centre - dynamic_object.world_from_object.translation
    )
    turning = (
        float(np.linalg.norm(dynamic_object.twist.angular_rad_s)) * dynamic_object.mesh.radius_m
    )
    return middle.speed_m_s + turning
