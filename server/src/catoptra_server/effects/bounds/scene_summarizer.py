"""Summary of all bounds of a camera state, for the criteria of effects.

Bounds are computed where a criterion reads them, those of the static scene once: a summary for
`SelfView` alone measures no distances, and takes as long among 64 robots as alone in worlds without
point lights. Distances, speeds and rates are rounded outward (`round_outward`), so that frames of a
driving robot share a summary for a while.

No surface is farther than a box around the scene and the spheres around dynamic objects. Nearest
distances and rates of dynamic objects follow, ring by ring, from the boxes around a few dozen of
their triangles each. Objects move from frame to frame, so nothing but the boxes in the object's own
frame is cached.

A robot in its own mirror moves as one with the mirror, so its extent and distance are computed once
for a camera. Extremes of the angle from the axis lie at corners or on edges, or are 0 or pi for a
triangle that contains a pole. Source: spherical trigonometry; on the great circle through two
points, the direction farthest from an axis is the opposite of the axis, projected into the circle's
plane.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection
from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np

from catoptra_protocol.optics.elementary import arcsin, arctan, arctan2, dot, einsum, hypot, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import NUM_RINGS, UNCHANGED, Gains, SceneSummary
from catoptra_server.effects.bounds.coordinate_rounding import (
    CoordinateErrors,
    CoordinateRounding,
    round_away_from_zero,
    round_down,
    round_twist,
)
from catoptra_server.effects.bounds.distances import (
    DistanceBoundCache,
    ImageRings,
    box_distance_bounds,
    image_rings,
    mirror_axis,
    rotation_to_axis,
)
from catoptra_server.effects.bounds.light_loss import ObjectRadiances, max_radiance
from catoptra_server.effects.bounds.shadow_bounds import ShadowBounds
from catoptra_server.world.objects import (
    CameraState,
    DynamicObject,
    ObjectMesh,
    scene_twist_in_mirror,
)
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import are_lit_alike, open_irradiance
from catoptra_server.world.triangles import make_clusters
from catoptra_server.world.world_description import World

_ALL_FIELDS = frozenset(field.name for field in dataclasses.fields(SceneSummary))
_RADIANCE_FIELDS = frozenset(
    "max_radiance background_radiance camera_key max_fresnel light_bake open_irradiance"
    " has_bodies".split()
)
_DISTANCE_FIELDS = frozenset({"min_distances_m", "max_object_rates_rad_s"})


class SceneSummarizer:
    """Summaries of one world."""

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self.scene = scene
        """The scene."""
        self._world = world
        self._object_radiances = ObjectRadiances(world)
        self._object_bounds = _DynamicObjectBounds()
        self._open_irradiance = open_irradiance(world.lights)

    def repaint(self, scene: SceneMesh, world: World) -> None:
        """Summarize the same triangles in other looks and light; distances stay."""
        if scene is self.scene and are_lit_alike(world, self._world):
            return
        self.scene, self._world = scene, world
        self._object_radiances = ObjectRadiances(world)
        self._open_irradiance = open_irradiance(world.lights)
        for name in ("_shadows", "max_radiance"):
            self.__dict__.pop(name, None)

    # On demand: many cameras need no bounds of many triangles.
    @cached_property
    def _distance_bounds(self) -> DistanceBoundCache:
        return DistanceBoundCache(self.scene.hierarchy())

    @cached_property
    def _shadows(self) -> ShadowBounds:
        return ShadowBounds(self.scene, self._world)

    @cached_property
    def _rounding(self) -> CoordinateRounding:
        return CoordinateRounding(self.scene)

    @cached_property
    def max_radiance(self) -> float:
        """Largest radiance of the static scene."""
        return max_radiance(self.scene, self._world)

    def max_rounding_angle_rad(self, camera_state: CameraState, errors: CoordinateErrors) -> float:
        """Angle by which a renderer's coordinates displace nothing farther, rounded up.

        Args:
            camera_state: State with all objects in view.
            errors: Errors of the renderer's coordinates.
        """
        angle_rad = self._rounding.max_angle_rad(
            camera_state.world_from_mirror.translation, camera_state.objects, errors
        )
        return round_away_from_zero((angle_rad,))[0]

    def min_distance_m(self, camera_state: CameraState, *, has_ego_body: bool) -> float:
        """Lower bound of the distance of everything in view from the viewpoint, metres.

        Args:
            camera_state: State with all objects in view.
            has_ego_body: Whether the own robot is in view, too.
        """
        shown = _objects_with_ego_body(camera_state) if has_ego_body else camera_state.objects
        return self._rounding.min_distance_m(camera_state.world_from_mirror.translation, shown)

    def _bound_objects(self, objects: tuple[DynamicObject, ...]) -> float:
        """Largest radiance of any object, rounded up; 0 without objects."""
        return round_away_from_zero((self._object_radiances.max_radiance(objects),))[0]

    def summarize(
        self,
        camera_state: CameraState,
        camera: RadialCamera,
        fields: Collection[str] = _ALL_FIELDS,
        gains: Gains = UNCHANGED,
    ) -> SceneSummary:
        """Summary of a camera state.

        Args:
            camera_state: State with all objects in view.
            camera: Camera of the image.
            fields: Fields that criteria read; all others have their defaults, no radiance, or are
                bounds, too. The ego body counts where `SelfView` may add it: where
                `ego_body_max_angle_rad` is read.
            gains: Factors from light at the effect Shadows to that of the finished picture.
        """
        objects, ego_body = camera_state.objects, camera_state.ego_body
        # Any: fields of several types. Made once, as a copy takes as long as all of the radiance.
        values: dict[str, Any] = {
            "max_radiance": 0.0,
            # Whether any pixel shows the background is not decided: only a closed room shows none,
            # and walls of the bundled worlds merely touch.
            "background_radiance": self._world.background_range,
            "camera_key": camera_state.noise_seed.camera_key,
            "max_fresnel": self.scene.max_fresnel,
            "light_bake": self.scene.baked_light,
            "open_irradiance": self._open_irradiance,
            "has_bodies": bool(objects or ego_body),
        }
        if "max_radiance" in fields:
            values["max_radiance"] = max(self.max_radiance, self._bound_objects(objects))
        if _RADIANCE_FIELDS.issuperset(fields):
            return SceneSummary(**values)
        camera_state = _rotate_to_optical_axis(camera_state, camera)
        if "source_light_px" in fields:
            # For the cameras whose lens scatters light alone.
            from catoptra_server.effects.kernels.light_sources import max_source_light_px

            viewpoint = camera_state.world_from_mirror.translation
            light_px = max_source_light_px(self._world.lights, camera, viewpoint)
            values["source_light_px"] = round_away_from_zero((light_px,))[0]
        has_self_view = "ego_body_max_angle_rad" in fields
        # A lens's own robot is not in view: no effect of such a camera adds the robot.
        if has_self_view and ego_body and isinstance(camera, OmniCamera) and camera.has_mirror:
            own = _bound_self_view(camera_state.world_from_mirror, ego_body, camera)
            values["ego_body_max_radiance"] = self._bound_objects((ego_body,))
            values["ego_body_max_angle_rad"] = own.max_angle_rad
            values["ego_body_min_distances_m"] = own.min_distances_m
        with_ego_body = _objects_with_ego_body(camera_state)
        if "scene_twist" in fields:
            values["scene_twist"] = round_twist(scene_twist_in_mirror(camera_state))
        if "max_distance_m" in fields:
            viewpoint = camera_state.world_from_mirror.translation
            values["max_distance_m"] = _max_distance_m(self.scene, viewpoint, with_ego_body)
        if "max_shadow_loss" in fields:
            values["max_shadow_loss"] = self._shadows.darkest_shadow(objects, gains)
            if has_self_view:
                shadow = self._shadows.darkest_shadow(with_ego_body, gains)
                values["max_shadow_loss_with_ego_body"] = shadow
        if not _DISTANCE_FIELDS.isdisjoint(fields):
            distances_m = self._distance_bounds.min_distances_m(
                camera_state.world_from_mirror, camera
            )
            values["min_distances_m"] = distances_m
            if objects:
                values |= self._bound_distances(distances_m, camera_state, camera)
        return SceneSummary(**values)

    def _bound_distances(
        self, of_scene_m: tuple[float, ...], camera_state: CameraState, camera: RadialCamera
    ) -> dict[str, tuple[float, ...]]:
        """Fields about distances of the scene with its dynamic objects."""
        pose = camera_state.world_from_mirror
        rotation, rings = rotation_to_axis(mirror_axis(pose)), image_rings(camera)
        of_objects, rates = self._object_bounds.bound(
            camera_state.objects, pose.translation, rotation, rings
        )
        # The static distances are rounded already; rounding twice would loosen them.
        nearest = map(min, of_scene_m, round_down(of_objects.tolist()))
        passing = round_away_from_zero(rates.tolist())
        return {"min_distances_m": tuple(nearest), "max_object_rates_rad_s": passing}


def _rotate_to_optical_axis(camera_state: CameraState, camera: RadialCamera) -> CameraState:
    """Same state in a frame whose z is the optical axis, as all bounds have it."""
    axis = camera.optical_axis
    if axis == (0.0, 0.0, 1.0):
        return camera_state
    turned = camera_state.world_from_mirror @ Pose(rotation_to_axis(axis).T, np.zeros(3))
    return replace(camera_state, world_from_mirror=turned)


def _objects_with_ego_body(camera_state: CameraState) -> tuple[DynamicObject, ...]:
    ego_body = () if camera_state.ego_body is None else (camera_state.ego_body,)
    return (*camera_state.objects, *ego_body)


def _max_distance_m(
    scene: SceneMesh, viewpoint: Floats, objects: tuple[DynamicObject, ...]
) -> float:
    """Distance from a (3,) viewpoint beyond which there is no surface, rounded up."""
    of_scene = hypot(*(np.maximum(viewpoint - scene.box_min, scene.box_max - viewpoint)))
    # An empty scene has an inverted, infinite box.
    farthest = float(of_scene) if math.isfinite(of_scene) else 0.0
    for dynamic_object in objects:
        centre_m = hypot(*(dynamic_object.centre - viewpoint))
        farthest = max(farthest, centre_m + dynamic_object.mesh.radius_m)
    return round_away_from_zero((farthest,))[0]


# The relative pose is constant but for rounding: equal to a nanometre, so one cache key.
_DECIMALS = 9
_FLIP_Z = np.array((1.0, 1.0, -1.0))


@dataclass(frozen=True, slots=True)
class _SelfViewBounds:
    """Bounds of a body in the image of a camera on the body."""

    max_angle_rad: float = 0.0
    """Largest angle from the axis of any visible part; 0 for none."""
    min_distances_m: tuple[float, ...] = (math.inf,) * NUM_RINGS
    """Distance bound of each ring."""


_NOT_VISIBLE = _SelfViewBounds()


def _bound_self_view(
    world_from_mirror: Pose, body: DynamicObject, camera: OmniCamera
) -> _SelfViewBounds:
    """Bounds of the robot that carries a camera, in the camera's image."""
    own = body.world_from_object
    # The body's axes and its origin, in the mirror frame.
    rows = np.vstack((own.rotation.T, own.translation - world_from_mirror.translation))
    values = matmul(rows, world_from_mirror.rotation).round(_DECIMALS).ravel()
    return _bound_mesh(body.mesh, tuple(values.tolist()), camera)


@lru_cache(maxsize=32)
def _bound_mesh(
    mesh: ObjectMesh, pose_values: tuple[float, ...], camera: OmniCamera
) -> _SelfViewBounds:
    # Numbers rather than a Pose as arguments: arrays are not hashable.
    pose = Pose(np.reshape(pose_values[:9], (3, 3)).T, np.array(pose_values[9:]))
    corners = pose.transform_points(mesh.corners)
    min_angle = math.pi - _max_angle_from_axis(corners * _FLIP_Z)
    max_angle = _max_angle_from_axis(corners)
    # Occlusion is not considered: a hidden part counts as visible.
    is_visible = min_angle <= camera.rim_rad
    if not is_visible.any():
        return _NOT_VISIBLE
    distance = _min_distances(corners, pose.rotate_directions(mesh.normals))
    radius = np.linspace(0.0, camera.rim_radius_px, NUM_RINGS + 1) / camera.scale_px
    border = 2.0 * arctan(camera.projection.t_from_radius_ratio(radius))
    of_rings = (
        distance[(min_angle <= outer) & (max_angle >= inner)]
        for inner, outer in pairwise(border.tolist())
    )
    by_ring = tuple(float(of_ring.min(initial=math.inf)) for of_ring in of_rings)
    return _SelfViewBounds(float(max_angle[is_visible].max()), by_ring)


def _min_distances(corners: Floats, normals: Floats) -> Floats:
    """(n,) distances from the origin within which there is no point of a triangle.

    The larger of the distances to the triangle's box and to its plane.
    """
    outside = np.maximum(np.maximum(corners.min(axis=1), -corners.max(axis=1)), 0.0)
    to_plane = np.abs(einsum("ni,ni->n", normals, corners[:, 0]))
    distance: Floats = np.maximum(np.linalg.norm(outside, axis=-1), to_plane)
    return distance


def _max_angle_from_axis(corners: Floats) -> Floats:
    """(n,) largest angle from +z of any point of (n, 3, 3) triangles."""
    angle = arctan2(hypot(corners[..., 0], corners[..., 1]), corners[..., 2])
    ends = np.roll(corners, -1, axis=1)
    farthest = np.maximum(angle.max(axis=1), _max_angle_on_edges(corners, ends).max(axis=1))
    return np.where(_contains_antipole(corners), math.pi, farthest)


def _max_angle_on_edges(starts: Floats, ends: Floats) -> Floats:
    """Largest angle from +z between the ends of edges; 0 where an end has the largest."""
    normal = np.cross(starts, ends)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    normal = normal / np.where(length > 0.0, length, 1.0)
    extreme = normal * normal[..., 2:] - np.array((0.0, 0.0, 1.0))
    after = dot(np.cross(starts, extreme), normal) > 0.0
    before = dot(np.cross(extreme, ends), normal) > 0.0
    # The extreme direction counts only between the ends, on the shorter arc.
    within = after & before & (length[..., 0] > 0.0)
    return np.where(within, math.pi - arcsin(np.minimum(np.abs(normal[..., 2]), 1.0)), 0.0)


def _contains_antipole(corners: Floats) -> Bools:
    """(n,) triangles of (n, 3, 3) that the ray along -z intersects."""
    a, b, c = np.moveaxis(corners, 1, 0)
    sides = np.stack([np.cross(p, q)[:, 2] for p, q in ((b, c), (c, a), (a, b))], axis=-1)
    volume = einsum("ni,ni->n", a, np.cross(b, c))[:, None]
    # Barycentric weights of -z by Cramer's rule; all non-negative inside.
    weights = -sides * np.sign(volume)
    return np.asarray((weights >= 0.0).all(axis=-1) & (volume[:, 0] != 0.0))


# A P2AT of 704 triangles is 22 boxes: 0.7 ms a frame and robot, most of that NumPy's overhead.
_TRIANGLES_PER_BOX = 32


class _DynamicObjectBounds:
    """Bounds of objects, with the boxes of every mesh so far."""

    def __init__(self) -> None:
        self._boxes: dict[ObjectMesh, tuple[Floats, Floats]] = {}

    def bound(
        self,
        objects: tuple[DynamicObject, ...],
        viewpoint: Floats,
        axis_rotation: Floats,
        rings: ImageRings,
    ) -> tuple[Floats, Floats]:
        """Bounds of all objects together.

        Args:
            viewpoint: (3,) metres, world frame.
            axis_rotation: (3, 3) from the world to axes whose z is the mirror axis.

        Returns:
            (NUM_RINGS,) distances within which no object is shown, inf where none is; and
            (NUM_RINGS,) angular rates at which moving objects pass by, at most, rad/s.
        """
        nearest, passing = np.full(NUM_RINGS, np.inf), np.zeros(NUM_RINGS)
        for dynamic_object in objects:
            bounds = self._ring_bounds(dynamic_object, viewpoint, axis_rotation, rings)
            nearest = np.minimum(nearest, bounds)
            speed_m_s = _max_speed_m_s(dynamic_object)
            # The viewpoint may lie in a box; a micrometre keeps the quotient finite.
            if speed_m_s > 0.0:
                passing = np.maximum(passing, speed_m_s / np.maximum(bounds, 1e-6))
        return nearest, passing

    def _ring_bounds(
        self,
        dynamic_object: DynamicObject,
        viewpoint: Floats,
        axis_rotation: Floats,
        rings: ImageRings,
    ) -> Floats:
        centres, halves = self._mesh_boxes(dynamic_object.mesh)
        axes = matmul(axis_rotation, dynamic_object.world_from_object.rotation)
        centre = matmul(centres, axes.T) + matmul(
            axis_rotation, dynamic_object.world_from_object.translation - viewpoint
        )
        # A rotated box lies in the box of its rotated half axes: |R| h.
        half = matmul(halves, np.abs(axes).T)
        bounds: Floats = box_distance_bounds(centre - half, centre + half, rings).min(axis=0)
        return bounds

    def _mesh_boxes(self, mesh: ObjectMesh) -> tuple[Floats, Floats]:
        if mesh not in self._boxes:
            group = np.zeros(len(mesh), dtype=np.intp)
            clusters = make_clusters(mesh.corners, group, size=_TRIANGLES_PER_BOX)
            self._boxes[mesh] = clusters.centres, clusters.half_sizes
        return self._boxes[mesh]


def _max_speed_m_s(dynamic_object: DynamicObject) -> float:
    """Speed in the world that no point of an object exceeds: the bounding sphere's."""
    sphere_centre = dynamic_object.twist.at_offset(
        dynamic_object.centre - dynamic_object.world_from_object.translation
    )
    turning = hypot(*dynamic_object.twist.angular_rad_s) * dynamic_object.mesh.radius_m
    return sphere_centre.speed_m_s + turning
