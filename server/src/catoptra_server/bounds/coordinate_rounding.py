"""Angle by which the rounding of a scene's coordinates displaces things, seen from a viewpoint.

Renderers hold corners and viewpoint as float32, relative to the centre of the scene. A corner is
off by a part in 2^24 of its distance from there, a point of a triangle by what its farthest corner
is off, and the arithmetic on both by as much again: all are lengths, proportional to the
viewpoint's distance from the centre and to the triangle's size. Over the triangle's distance from
the viewpoint a length is an angle; the largest of all triangles counts.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.bounds.nearness import Nearness, NearTriangles
from catoptra_server.world.objects import DynamicObject, ObjectMesh
from catoptra_server.world.scene_mesh import SceneMesh

UNIT_ROUNDOFF = 2.0**-24
"""Largest relative error of rounding to float32."""


@dataclass(frozen=True, slots=True)
class CoordinateErrors:
    """Displacements by a renderer's coordinates, in units of 2^-24."""

    position_ulps: float
    """Of any point, over the viewpoint's distance from the centre of the scene."""
    size_ulps: float
    """Of the points of a triangle, over the sum of its size and distance."""
    miss_m: float = 0.0
    """Not by coordinates: distance at which rays taken to meet in the viewpoint pass it, metres."""


class CoordinateRounding:
    """Displacements in one scene with its dynamic objects."""

    def __init__(self, scene: SceneMesh) -> None:
        self._scene = scene
        self._objects: dict[ObjectMesh, NearTriangles] = {}

    @cached_property
    def _triangles(self) -> NearTriangles:
        # On demand: 0.1 s for a million triangles, which a camera without a bound does not need.
        return NearTriangles(self._scene.corners)

    @cached_property
    def _centre(self) -> Floats:
        """(3,) origin of the renderers' coordinates."""
        if not len(self._scene):
            return np.zeros(3)
        return np.asarray(0.5 * (self._scene.box_min + self._scene.box_max))

    def max_angle_rad(
        self, viewpoint: Floats, objects: tuple[DynamicObject, ...], errors: CoordinateErrors
    ) -> float:
        """Angle by which no point is displaced farther; at most pi.

        Args:
            viewpoint: (3,) metres, world frame.
            objects: Dynamic objects in view.
            errors: Errors of the renderer's coordinates.
        """
        position_m = errors.position_ulps * math.dist(viewpoint, self._centre)
        position_m += errors.miss_m / UNIT_ROUNDOFF
        of_scene = self._triangles.nearness(viewpoint)
        angle_ulps = _angle_ulps(of_scene, position_m, errors.size_ulps)
        for one in objects:
            near = self._object_nearness(one, viewpoint)
            # Its corners are rounded in its own frame, within its sphere.
            own_m = 2.0 * errors.size_ulps * one.mesh.radius_m
            angle_ulps = max(angle_ulps, _angle_ulps(near, position_m + own_m, errors.size_ulps))
        return min(angle_ulps * UNIT_ROUNDOFF, math.pi)

    def min_distance_m(self, viewpoint: Floats, objects: tuple[DynamicObject, ...]) -> float:
        """Lower bound of the distance of all triangles from a (3,) viewpoint, metres.

        Two fifths of the nearest one's at least, as in `NearTriangles`; inf without any.
        """
        near = [self._triangles.nearness(viewpoint)]
        near += [self._object_nearness(one, viewpoint) for one in objects]
        inverse = max(one.inverse_distance_per_m for one in near)
        return 1.0 / inverse if inverse > 0.0 else math.inf

    def _object_nearness(self, one: DynamicObject, viewpoint: Floats) -> Nearness:
        distance_m = math.dist(viewpoint, one.centre) - one.mesh.radius_m
        # Most objects are far, and then their sphere is exact enough.
        if distance_m > one.mesh.radius_m:
            return Nearness(1.0 / distance_m, 2.0 * one.mesh.radius_m / distance_m)
        if one.mesh not in self._objects:
            self._objects[one.mesh] = NearTriangles(one.mesh.corners)
        in_object = one.world_from_object.inverse().transform_points(viewpoint)
        return self._objects[one.mesh].nearness(in_object)


def _angle_ulps(near: Nearness, position_ulp_m: float, size_ulps: float) -> float:
    return (
        position_ulp_m * near.inverse_distance_per_m
        + size_ulps * near.size_per_distance
        + size_ulps
    )
