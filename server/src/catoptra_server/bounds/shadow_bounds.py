"""The most that shadows can take from a scene: found once, and for bodies where they come.

Of every triangle: what it has of lights that something could hide (`occluders`), point lights from
the nearest place of its box, and what it has left without them. The triangle whose encoded light
would change most speaks for all; textures may darken one by any factor. A body can hide any light
from anything, and is white: it has at most what all lights give it, and at least the dimmer half of
the sky.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.bounds import round_outward
from catoptra_server.bounds.radiance_loss import grey_level_change, max_visible_loss
from catoptra_server.bounds.shadow_candidates import shadow_candidates
from catoptra_server.effects.scene_summary import NO_SHADOW_LOSS, ShadowLoss
from catoptra_server.scene import shading
from catoptra_server.scene.dynamic_object import DynamicObject
from catoptra_server.scene.radiance_bounds import max_point_irradiance
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.shading import ShadowCastingLight
from catoptra_server.scene.world_description import DirectionalLight, PointLight, World

# As near as shading lets a light come, metres.
_MIN_DISTANCE_M = 1e-3


class ShadowBounds:
    """What exposures of one world can lose."""

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self._scene = scene
        self._lights = shading.shadow_casting_lights(world.lights)
        self._hemisphere_lights = shading.hemisphere_lights(world.lights)

    def darkest_shadow(self, objects: tuple[DynamicObject, ...]) -> ShadowLoss:
        """Return the darkest shadow that a scene and bodies could cast."""
        if not self._lights:
            return NO_SHADOW_LOSS
        if not objects:
            return self._static_shadow
        return max((self._full_shadow, self._object_shadow(objects)), key=grey_level_change)

    @cached_property
    def _static_shadow(self) -> ShadowLoss:
        """Return what stands hides from what stands: half a second for a million triangles."""
        lost = np.zeros_like(self._scene.albedo)
        left = shading.facet_irradiance(self._hemisphere_lights, self._scene.normals)
        for light in self._lights:
            irradiance = self._max_irradiance(light)
            is_lost = shadow_candidates(self._scene, light)[:, None]
            lost += np.where(is_lost, irradiance, 0.0)
            if isinstance(light, DirectionalLight):
                left += np.where(is_lost, 0.0, irradiance)
        return self._max_loss(lost, left)

    @cached_property
    def _full_shadow(self) -> ShadowLoss:
        left = shading.facet_irradiance(self._hemisphere_lights, self._scene.normals)
        lost: Floats = sum(
            (self._max_irradiance(light) for light in self._lights), np.zeros((1, 3))
        )
        return self._max_loss(lost, left)

    def _max_irradiance(self, light: ShadowCastingLight) -> Floats:
        """Return (n, 3): at most what a light gives each triangle."""
        if isinstance(light, PointLight):
            return max_point_irradiance(self._scene.corners, light)[0]
        return shading.facet_irradiance((light,), self._scene.normals)

    def _max_loss(self, lost_irradiance: Floats, remaining_irradiance: Floats) -> ShadowLoss:
        """Return the loss of light that changes a triangle's picture most, of (n, 3) irradiance."""
        lit = self._scene.albedo * ~self._scene.unlit[:, None]
        return max_visible_loss(
            lost_irradiance * lit,
            remaining_irradiance * lit,
            can_be_darker=self._scene.texture_index >= 0,
        )

    def _object_shadow(self, objects: tuple[DynamicObject, ...]) -> ShadowLoss:
        """Return what white bodies can lose, however they are turned."""
        left, lost = np.zeros(3), np.zeros(3)
        for sky in self._hemisphere_lights:
            left += np.minimum(sky.up_irradiance, sky.down_irradiance)
        for light in self._lights:
            if isinstance(light, PointLight):
                nearest = round_outward.round_down([_min_distance_m(light, objects)])[0]
                lost += np.asarray(light.intensity) / max(nearest, _MIN_DISTANCE_M) ** 2
            else:
                lost += np.asarray(light.irradiance)
        return max_visible_loss(lost[None], left[None], can_be_darker=np.array([True]))


def _min_distance_m(light: PointLight, objects: tuple[DynamicObject, ...]) -> float:
    at = np.asarray(light.position_m)
    return min(float(np.linalg.norm(at - body.centre)) - body.mesh.radius_m for body in objects)
