"""Largest visible loss of light by shadows: of the static scene once, of dynamic objects in a
frame.

Each triangle has the irradiance of the lights that a surface could occlude (`shadow_candidates`),
point lights from the nearest point of the triangle's box, and the irradiance that remains without
them. The triangle whose encoded colour would change most decides; a texture may darken a triangle
by any factor. A dynamic object can occlude any light from any surface, and counts as white: at most
lit by all lights, at least by the dimmer half of the sky.
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
from catoptra_server.scene.row_blocks import row_blocks
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.shading import ShadowCastingLight
from catoptra_server.scene.world_description import DirectionalLight, PointLight, World

# Shading clamps the distance of a point light to this as well, metres.
_MIN_DISTANCE_M = 1e-3


class ShadowBounds:
    """Shadow losses of one world."""

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self._scene = scene
        self._lights = shading.shadow_casting_lights(world.lights)
        self._hemisphere_lights = shading.hemisphere_lights(world.lights)

    def darkest_shadow(self, objects: tuple[DynamicObject, ...]) -> ShadowLoss:
        """Largest visible loss by any shadow that the scene or dynamic objects could cast."""
        if not self._lights:
            return NO_SHADOW_LOSS
        if not objects:
            return self._static_shadow
        return max((self._full_shadow, self._object_shadow(objects)), key=grey_level_change)

    @cached_property
    def _static_shadow(self) -> ShadowLoss:
        """Loss by shadows of the static scene on itself: half a second for a million triangles."""
        lost = np.zeros_like(self._scene.albedo)
        remaining = shading.facet_irradiance(self._hemisphere_lights, self._scene.normals)
        for light in self._lights:
            irradiance = self._max_irradiance(light)
            can_be_lost = shadow_candidates(self._scene, light)[:, None]
            lost += np.where(can_be_lost, irradiance, 0.0)
            if isinstance(light, DirectionalLight):
                # A point light's irradiance is an upper bound, so only a directional light may
                # count as remaining.
                remaining += np.where(can_be_lost, 0.0, irradiance)
        return self._max_loss(lost, remaining)

    @cached_property
    def _full_shadow(self) -> ShadowLoss:
        """Loss of a scene whose every surface loses every light, as objects anywhere could
        cause."""
        remaining = shading.facet_irradiance(self._hemisphere_lights, self._scene.normals)
        lost: Floats = sum(
            (self._max_irradiance(light) for light in self._lights), np.zeros((1, 3))
        )
        return self._max_loss(lost, remaining)

    def _max_irradiance(self, light: ShadowCastingLight) -> Floats:
        """(n, 3) largest irradiance by a light on each triangle."""
        if isinstance(light, PointLight):
            return max_point_irradiance(self._scene.corners, light)[0]
        return shading.facet_irradiance((light,), self._scene.normals)

    def _max_loss(self, lost_irradiance: Floats, remaining_irradiance: Floats) -> ShadowLoss:
        """Most visible loss of any triangle, of (n, 3) irradiance."""
        lost, remaining = np.broadcast_arrays(lost_irradiance, remaining_irradiance)
        losses = (
            self._max_loss_in_block(block, lost[block], remaining[block])
            for block in row_blocks(len(remaining))
        )
        return max(losses, key=grey_level_change, default=NO_SHADOW_LOSS)

    def _max_loss_in_block(
        self, block: slice, lost_irradiance: Floats, remaining_irradiance: Floats
    ) -> ShadowLoss:
        """Most visible loss of the triangles of a block."""
        lit = self._scene.max_albedo(block) * ~self._scene.unlit[block, None]
        return max_visible_loss(
            lost_irradiance * lit,
            remaining_irradiance * lit,
            can_be_darker=self._scene.has_varying_albedo(block),
        )

    def _object_shadow(self, objects: tuple[DynamicObject, ...]) -> ShadowLoss:
        """Loss of white objects at any orientation."""
        remaining, lost = np.zeros(3), np.zeros(3)
        for sky in self._hemisphere_lights:
            # The less remains, the steeper the sRGB curve: the smaller irradiance is the safe one.
            remaining += np.minimum(sky.up_irradiance, sky.down_irradiance)
        for light in self._lights:
            if isinstance(light, PointLight):
                # Rounded, so that a moving object changes the summary, and the decisions cached by
                # it, rarely.
                nearest = round_outward.round_down([_min_distance_m(light, objects)])[0]
                lost += np.asarray(light.intensity) / max(nearest, _MIN_DISTANCE_M) ** 2
            else:
                lost += np.asarray(light.irradiance)
        return max_visible_loss(lost[None], remaining[None], can_be_darker=np.array([True]))


def _min_distance_m(light: PointLight, objects: tuple[DynamicObject, ...]) -> float:
    position = np.asarray(light.position_m)
    return min(float(np.linalg.norm(position - one.centre)) - one.mesh.radius_m for one in objects)
