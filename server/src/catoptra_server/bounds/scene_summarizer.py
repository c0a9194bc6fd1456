"""What the exposures of one scene can show at most: what never changes is found only once.

Who asks for light alone pays for no distances. Distances, speeds and rates are rounded outward, so
that frames of a robot that drives have the same summary for a while (`coarse`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.bounds import round_outward
from catoptra_server.bounds.distance_bound_cache import (
    DistanceBoundCache,
    mirror_axis,
    rotation_to_axis,
)
from catoptra_server.bounds.dynamic_object_bounds import DynamicObjectBounds
from catoptra_server.bounds.image_rings import image_rings
from catoptra_server.bounds.scene_bounds import SceneBounds
from catoptra_server.bounds.self_view_bounds import bound_self_view
from catoptra_server.bounds.shadow_bounds import ShadowBounds
from catoptra_server.capture.camera_state import CameraState, scene_twist_in_mirror
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.scene.dynamic_object import DynamicObject
from catoptra_server.scene.radiance_bounds import max_radiance
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.world_description import World


class SceneSummarizer:
    """The summaries of one world; every renderer has one."""

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self._scene = scene
        self._world = world
        self._distance_bounds = DistanceBoundCache(scene)
        self._bounds = SceneBounds(scene)
        self._object_bounds = DynamicObjectBounds()
        self._shadows = ShadowBounds(scene, world)

    @cached_property
    def max_radiance(self) -> float:
        """Return the brightest light that the scene can show; found when it is first asked for."""
        return max_radiance(self._scene, self._world)

    def summarize_radiance(self) -> SceneSummary:
        """Return what every exposure can show at most, as far as light goes."""
        return SceneSummary(self.max_radiance)

    def summarize(self, camera_state: CameraState, camera: OmniCamera) -> SceneSummary:
        """Return what an exposure can show at most.

        Its farthest distance is infinite: that no picture shows the background could be told of
        closed rooms alone, and the shipped ones are made of walls that only touch.
        """
        own = bound_self_view(camera_state, camera)
        summary = SceneSummary(
            self.max_radiance,
            self._distance_bounds.min_distances_m(camera_state.world_from_mirror, camera),
            max_distance_m=self._bounds.max_distance_m(
                camera_state.world_from_mirror.translation, _objects_with_ego_body(camera_state)
            ),
            background_radiance=self._world.background,
            scene_twist=round_outward.round_twist(scene_twist_in_mirror(camera_state)),
            ego_body_max_angle_rad=own.max_angle_rad,
            ego_body_min_distances_m=own.min_distances_m,
            max_shadow_loss=self._shadows.darkest_shadow(camera_state.objects),
            max_shadow_loss_with_ego_body=self._shadows.darkest_shadow(
                _objects_with_ego_body(camera_state)
            ),
        )
        return (
            self._add_dynamic_objects(summary, camera_state, camera)
            if camera_state.objects
            else summary
        )

    def _add_dynamic_objects(
        self, summary: SceneSummary, camera_state: CameraState, camera: OmniCamera
    ) -> SceneSummary:
        pose = camera_state.world_from_mirror
        turn, rings = rotation_to_axis(mirror_axis(pose)), image_rings(camera)
        around = self._object_bounds.bound(camera_state.objects, pose.translation, turn, rings)
        nearest = map(
            min, summary.min_distances_m, round_outward.round_down(around.min_distances_m.tolist())
        )
        passing = round_outward.round_away_from_zero(around.max_object_rates_rad_s.tolist())
        return replace(summary, min_distances_m=tuple(nearest), max_object_rates_rad_s=passing)


def _objects_with_ego_body(camera_state: CameraState) -> tuple[DynamicObject, ...]:
    own = () if camera_state.ego_body is None else (camera_state.ego_body,)
    return (*camera_state.objects, *own)
