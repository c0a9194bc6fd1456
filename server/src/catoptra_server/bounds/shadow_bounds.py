"""Largest visible loss of light by shadows: of the static scene once, of dynamic objects in a
frame.

Each triangle has the irradiance of the lights that a surface could occlude (`shadow_candidates`,
then `light_shafts` in the order of what each could lose), point lights from the nearest point of
the triangle's box, and the irradiance that remains without them. The triangle whose encoded colour
would change most decides; a texture may darken a triangle by any factor. A dynamic object can
occlude any light from any surface, and counts as white: at most lit by all lights, at least by the
dimmer half of the sky. Scenes of many triangles are bounded as a whole.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.bounds import round_outward
from catoptra_server.bounds.light_shafts import LightShafts
from catoptra_server.bounds.radiance_loss import (
    grey_level_change,
    max_visible_loss,
    visible_losses,
)
from catoptra_server.bounds.shadow_candidates import shadow_candidates
from catoptra_server.effects.scene_summary import NO_SHADOW_LOSS, ShadowLoss
from catoptra_server.world import shading
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.scene_radiance import max_facet_irradiance, max_point_irradiance
from catoptra_server.world.shading import ShadowCastingLight
from catoptra_server.world.triangles import row_blocks
from catoptra_server.world.world_description import DirectionalLight, PointLight, World

# Scenes with more triangles are bounded as a whole: a tenth of a second.
_MAX_TRIANGLES = 100_000
# Pairs of triangles that are tested, a tenth of a second; all others count as hidden.
_MAX_PAIRS = 1_500_000
# A test of one triangle takes as long as this many pairs, however few there are.
_PAIRS_PER_TEST = 1000
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
        """Loss by shadows of the static scene on itself."""
        if len(self._scene) > _MAX_TRIANGLES:
            return self._any_shadow
        # (l, n, 3): what each triangle could lose of each light.
        losses = np.zeros((len(self._lights), *self._scene.albedo.shape))
        remaining = self._hemisphere_irradiance()
        for lost, light in zip(losses, self._lights, strict=True):
            irradiance = np.broadcast_to(self._max_irradiance(light), lost.shape)
            can_be_lost = shadow_candidates(self._scene, light)[:, None]
            lost += np.where(can_be_lost, irradiance, 0.0)
            if isinstance(light, DirectionalLight):
                # A point light's irradiance is an upper bound, so only a directional light may
                # count as remaining.
                remaining += np.where(can_be_lost, 0.0, irradiance)
        return self._search_largest(losses, remaining)

    def _search_largest(self, losses: Floats, remaining: Floats) -> ShadowLoss:
        """Most visible loss of any triangle, tested in order of what each could lose at most."""
        potential = self._visible_losses(losses.sum(axis=0), remaining)
        order = np.argsort(-potential, kind="stable")
        shafts = [LightShafts(self._scene, light) for light in self._lights]
        is_directional = np.array([isinstance(one, DirectionalLight) for one in self._lights])
        pairs_left, worst = _MAX_PAIRS, NO_SHADOW_LOSS
        for triangle in order:
            if potential[triangle] <= grey_level_change(worst):
                break
            of_lights = losses[:, triangle]
            pairs_left -= sum(_PAIRS_PER_TEST + len(shaft) for shaft in shafts)
            if pairs_left > 0:
                hidden = np.array(
                    [
                        bool(lost.any()) and shaft.can_be_hidden(triangle)
                        for lost, shaft in zip(of_lights, shafts, strict=True)
                    ]
                )
            else:
                # The rest counts as hidden; none of it loses more than this one.
                hidden = np.ones(len(shafts), dtype=bool)
            block = slice(triangle, triangle + 1)
            kept = remaining[block] + of_lights[~hidden & is_directional].sum(axis=0)
            loss = self._max_loss_in_block(block, of_lights[hidden].sum(axis=0)[None], kept)
            worst = max(worst, loss, key=grey_level_change)
            if pairs_left <= 0:
                break
        return worst

    @cached_property
    def _full_shadow(self) -> ShadowLoss:
        """Loss of a scene whose every surface loses every light, as objects anywhere could
        cause."""
        if len(self._scene) > _MAX_TRIANGLES:
            return self._any_shadow
        lost: Floats = sum(
            (self._max_irradiance(light) for light in self._lights), np.zeros((1, 3))
        )
        return self._max_loss(lost, self._hemisphere_irradiance())

    @cached_property
    def _any_shadow(self) -> ShadowLoss:
        """Loss of a surface with the largest albedo of the scene under all lights at once: for
        scenes whose triangles take too long to look at one by one."""
        remaining, lost = self._dimmest_sky(), np.zeros(3)
        for light in self._lights:
            if isinstance(light, PointLight):
                box = np.stack((self._scene.box_min, self._scene.box_max, self._scene.box_max))
                lost += max_point_irradiance(box[None], light)[0][0]
            else:
                lost += np.asarray(light.irradiance)
        albedo = np.max(
            [self._scene.max_albedo(block).max(axis=0) for block in row_blocks(len(self._scene))],
            axis=0,
        )
        return max_visible_loss(
            (albedo * lost)[None], (albedo * remaining)[None], can_be_darker=np.array([True])
        )

    def _hemisphere_irradiance(self) -> Floats:
        """(n, 3) irradiance by hemisphere lights where the scene hides most of the sky."""
        whole = shading.facet_irradiance(self._hemisphere_lights, self._scene.normals)
        factors = self._scene.smallest_sky_factors(slice(None))
        irradiance: Floats = factors[:, None] * whole
        return irradiance

    def _dimmest_sky(self) -> Floats:
        """(3,) least irradiance of all hemisphere lights on any facet."""
        # The less remains, the steeper the sRGB curve: the smaller irradiance is the safe one.
        darker = [
            np.minimum(sky.up_irradiance, sky.down_irradiance) for sky in self._hemisphere_lights
        ]
        total: Floats = np.sum(darker, axis=0) if darker else np.zeros(3)
        return total

    def _max_irradiance(self, light: ShadowCastingLight) -> Floats:
        """(n, 3) largest irradiance by a light on each triangle."""
        if isinstance(light, DirectionalLight):
            return shading.facet_irradiance((light,), self._scene.normals)
        return max_facet_irradiance(self._scene.corners, self._scene.normals, light)

    def _visible_losses(self, lost_irradiance: Floats, remaining_irradiance: Floats) -> Floats:
        """(n,) most visible losses of all triangles, grey levels."""
        losses = np.zeros(len(lost_irradiance))
        for block in row_blocks(len(losses)):
            lit = self._scene.max_albedo(block) * ~self._scene.unlit[block, None]
            losses[block] = visible_losses(
                lost_irradiance[block] * lit,
                remaining_irradiance[block] * lit,
                can_be_darker=self._scene.has_varying_albedo(block),
            )
        return losses

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
        remaining, lost = self._dimmest_sky(), np.zeros(3)
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
