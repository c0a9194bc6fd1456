"""Summary of all bounds of a camera state, for the criteria of effects.

Bounds of the static scene are computed once and on demand: a summary of radiance alone computes no
distances. Distances, speeds and rates are rounded outward (`round_outward`), so that frames of a
driving robot share a summary for a while.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.bounds import round_outward
from catoptra_server.bounds.coordinate_rounding import CoordinateErrors, CoordinateRounding
from catoptra_server.bounds.distance_bound_cache import (
    DistanceBoundCache,
    mirror_axis,
    rotation_to_axis,
)
from catoptra_server.bounds.dynamic_object_bounds import DynamicObjectBounds
from catoptra_server.bounds.image_rings import image_rings
from catoptra_server.bounds.scene_bounds import SceneBounds
from catoptra_server.bounds.self_view_bounds import NOT_VISIBLE, bound_self_view
from catoptra_server.bounds.shadow_bounds import ShadowBounds
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.world.camera_state import CameraState, scene_twist_in_mirror
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.scene_radiance import max_object_radiance, max_radiance
from catoptra_server.world.world_description import World


class SceneSummarizer:
    """Summaries of one world."""

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self.scene = scene
        """The scene."""
        self._world = world
        self._distance_bounds = DistanceBoundCache(scene)
        self._bounds = SceneBounds(scene)
        self._object_bounds = DynamicObjectBounds()
        self._shadows = ShadowBounds(scene, world)
        self._rounding = CoordinateRounding(scene)

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
        return round_outward.round_away_from_zero((angle_rad,))[0]

    def min_distance_m(self, camera_state: CameraState, *, has_ego_body: bool) -> float:
        """Lower bound of the distance of everything in view from the viewpoint, metres.

        Args:
            camera_state: State with all objects in view.
            has_ego_body: Whether the own robot is in view, too.
        """
        shown = _objects_with_ego_body(camera_state) if has_ego_body else camera_state.objects
        return self._rounding.min_distance_m(camera_state.world_from_mirror.translation, shown)

    def summarize_radiance(self, camera_state: CameraState) -> SceneSummary:
        """Summary of the radiance alone, of the scene and of the objects in view."""
        return SceneSummary(
            max(self.max_radiance, self._bound_objects(camera_state.objects)),
            camera_key=camera_state.noise_seed.camera_key,
        )

    def _bound_objects(self, objects: tuple[DynamicObject, ...]) -> float:
        """Largest radiance of any object, rounded up; 0 without objects."""
        radiances = [max_object_radiance(one, self._world) for one in objects]
        return round_outward.round_away_from_zero((max(radiances, default=0.0),))[0]

    def summarize(self, camera_state: CameraState, camera: RadialCamera) -> SceneSummary:
        """Summary of a camera state."""
        camera_state = _rotate_to_optical_axis(camera_state, camera)
        # A lens's own robot is not in view: no effect of such a camera adds the robot.
        ego_body = NOT_VISIBLE
        if isinstance(camera, OmniCamera) and camera.has_mirror:
            ego_body = bound_self_view(camera_state, camera)
        with_ego_body = _objects_with_ego_body(camera_state)
        ego_bodies = () if camera_state.ego_body is None else (camera_state.ego_body,)
        summary = SceneSummary(
            max(self.max_radiance, self._bound_objects(camera_state.objects)),
            self._distance_bounds.min_distances_m(camera_state.world_from_mirror, camera),
            max_distance_m=self._bounds.max_distance_m(
                camera_state.world_from_mirror.translation, with_ego_body
            ),
            # Whether any pixel shows the background is not decided: only a closed room shows none,
            # and walls of the bundled worlds merely touch.
            background_radiance=self._world.background,
            scene_twist=round_outward.round_twist(scene_twist_in_mirror(camera_state)),
            camera_key=camera_state.noise_seed.camera_key,
            ego_body_max_radiance=self._bound_objects(ego_bodies),
            ego_body_max_angle_rad=ego_body.max_angle_rad,
            ego_body_min_distances_m=ego_body.min_distances_m,
            max_shadow_loss=self._shadows.darkest_shadow(camera_state.objects),
            max_shadow_loss_with_ego_body=self._shadows.darkest_shadow(with_ego_body),
        )
        if not camera_state.objects:
            return summary
        return self._add_dynamic_objects(summary, camera_state, camera)

    def _add_dynamic_objects(
        self, summary: SceneSummary, camera_state: CameraState, camera: RadialCamera
    ) -> SceneSummary:
        pose = camera_state.world_from_mirror
        rotation, rings = rotation_to_axis(mirror_axis(pose)), image_rings(camera)
        proximity = self._object_bounds.bound(
            camera_state.objects, pose.translation, rotation, rings
        )
        # The static distances are rounded already; rounding twice would loosen them.
        nearest = map(
            min,
            summary.min_distances_m,
            round_outward.round_down(proximity.min_distances_m.tolist()),
        )
        passing = round_outward.round_away_from_zero(proximity.max_object_rates_rad_s.tolist())
        return replace(summary, min_distances_m=tuple(nearest), max_object_rates_rad_s=passing)


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
