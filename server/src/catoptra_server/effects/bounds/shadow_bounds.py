"""Largest visible loss of light by shadows: of the static scene once, of objects in each frame.

Each triangle has the irradiance of the lights that a surface could occlude, point lights from the
nearest point of the triangle's box, and the irradiance that remains without them. The triangle
whose encoded colour would change most decides; a texture may darken a triangle by any factor. A
dynamic object can occlude any light from any surface, and counts as white: at most lit by all
lights, at least by the dimmer half of the sky. Scenes of many triangles are bounded as a whole.

`_shadow_candidates` sorts out triangles without casting rays. For a triangle R to be occluded from
a light, R has to face the light; a corner of some caster has to lie in front of R's plane; and the
plane of some caster T has to separate the light from a corner of such an R. A floor, a single
convex object, or a convex room around a point light do not meet all three. A scene of many corners
counts with the corners of its box, which reaches farther.

`LightShafts` then decides for single triangles, in the order of what each could lose. The convex
hull of a receiver R and of a light is its shaft. A caster T occludes the light from some point of R
only if it is separated by no plane: the plane of R, with T behind it; the plane of T, with R on the
light's side; and the planes through the light and an edge of R or of T. The last ones are the
separating axes of two triangles in the light's projection (Ericson, Real-Time Collision Detection,
2005, 5.2.10), so that for one caster the test is exact but for a tolerance; two casters never help
each other, so it is exact for the scene: some point of R is hidden or none.
"""

from __future__ import annotations

from functools import cached_property, lru_cache
from itertools import product

import numpy as np

from catoptra_protocol.optics.elementary import einsum, hypot, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.effects import NO_SHADOW_LOSS, ShadowLoss
from catoptra_server.effects.bounds.coordinate_rounding import round_down
from catoptra_server.effects.bounds.light_loss import (
    grey_level_change,
    max_facet_irradiance,
    max_point_irradiance,
    max_visible_loss,
    visible_losses,
)
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import (
    MIN_LIGHT_DISTANCE_M,
    ShadowCastingLight,
    facet_irradiance,
    hemisphere_lights,
    point_lights,
    shadow_casting_lights,
)
from catoptra_server.world.shapes import bounding_box
from catoptra_server.world.triangles import row_blocks, select_rows
from catoptra_server.world.world_description import DirectionalLight, PointLight, World

# Scenes with more triangles are bounded as a whole: a tenth of a second.
_MAX_TRIANGLES = 100_000
# Pairs of triangles that are tested, a tenth of a second; all others count as hidden.
_MAX_PAIRS = 1_500_000
# A test of one triangle takes as long as this many pairs, however few there are.
_PAIRS_PER_TEST = 1000
# Distances of objects from the point lights, in cells.
_CACHE_SIZE = 256


class ShadowBounds:
    """Shadow losses of one world."""

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self._scene = scene
        self._lights = shadow_casting_lights(world.lights)
        self._point_lights = point_lights(world.lights)
        self._hemisphere_lights = hemisphere_lights(world.lights)
        # Per instance: a cache on the class would keep scenes alive.
        self._find_darkest = lru_cache(maxsize=_CACHE_SIZE)(self._find_darkest_with_objects)

    def darkest_shadow(self, objects: tuple[DynamicObject, ...]) -> ShadowLoss:
        """Largest visible loss by any shadow that the scene or dynamic objects could cast."""
        if not self._lights:
            return NO_SHADOW_LOSS
        if not objects:
            return self._static_shadow
        # Rounded: a moving object rarely changes the summary, by which decisions are cached.
        nearest_m = round_down(_min_distance_m(light, objects) for light in self._point_lights)
        return self._find_darkest(nearest_m)

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
            can_be_lost = _shadow_candidates(self._scene, light)[:, None]
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
                # The rest counts as hidden, and loses no more than this one.
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
        whole = facet_irradiance(self._hemisphere_lights, self._scene.normals)
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
            return facet_irradiance((light,), self._scene.normals)
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

    def _find_darkest_with_objects(self, nearest_m: tuple[float, ...]) -> ShadowLoss:
        """Largest loss of the scene, or of white objects at any orientation.

        Args:
            nearest_m: Distance of the objects from each point light.
        """
        remaining, lost = self._dimmest_sky(), np.zeros(3)
        for light in self._lights:
            if isinstance(light, DirectionalLight):
                lost += np.asarray(light.irradiance)
        for light, nearest in zip(self._point_lights, nearest_m, strict=True):
            lost += np.asarray(light.intensity) / max(
                nearest * nearest, MIN_LIGHT_DISTANCE_M * MIN_LIGHT_DISTANCE_M
            )
        of_objects = max_visible_loss(lost[None], remaining[None], can_be_darker=np.array([True]))
        return max((self._full_shadow, of_objects), key=grey_level_change)


def _min_distance_m(light: PointLight, objects: tuple[DynamicObject, ...]) -> float:
    position = np.asarray(light.position_m)
    return min(hypot(*(position - one.centre)) - one.mesh.radius_m for one in objects)


# A tenth of a second; beyond, a box stands for the corners.
_MAX_PRODUCTS = 10**7
_NUM_PROBED_TRIANGLES = 500


def _shadow_candidates(scene: SceneMesh, light: ShadowCastingLight) -> Bools:
    """(n,) triangles that the light faces and a surface of the scene might occlude."""
    none = np.zeros(len(scene), dtype=bool)
    # A copy of a million triangles takes a tenth of a second.
    casting = select_rows(scene.corners, scene.casts_shadows)
    if not len(casting):
        return none
    facing = _signed_light_distances(scene, light) > 0.0
    # Unlit and black surfaces look the same in a shadow.
    facing &= ~scene.unlit & np.logical_or.reduce(scene.albedo.T != 0.0)
    receivers = np.flatnonzero(facing)
    casters = _extreme_points(casting, num_planes=len(receivers))
    normals = scene.normals.take(receivers, axis=0)
    farthest = matmul(normals, casters.T).max(axis=1)
    receivers = receivers[farthest - _plane_offsets(scene, receivers) > _IN_PLANE_M]
    if not len(receivers) or not _has_separating_plane(
        scene, light, scene.corners.take(receivers, axis=0)
    ):
        return none
    none[receivers] = True
    return none


def _has_separating_plane(scene: SceneMesh, light: ShadowCastingLight, corners: Floats) -> bool:
    """Whether the plane of some caster separates the light from a corner of (k, 3, 3)."""
    casters = np.flatnonzero(scene.casts_shadows)
    height = _signed_light_distances(scene, light)[casters]
    reaches = np.abs(height) > _MIN_LIGHT_DISTANCE
    casters, height = casters[reaches], height[reaches]
    # Normals turned away from the light: a receiver's corner then lies in front of the plane.
    away = -np.sign(height)[:, None]
    receivers = _extreme_points(corners, num_planes=len(casters))
    # In most scenes a sample of the triangles already has such a plane.
    for part in (slice(None, None, 1 + len(casters) // _NUM_PROBED_TRIANGLES), slice(None)):
        normals = away[part] * scene.normals[casters[part]]
        offset = away[part, 0] * _plane_offsets(scene, casters[part])
        if (matmul(normals, receivers.T).max(axis=1) - offset > _IN_PLANE_M).any():
            return True
    return False


def _extreme_points(corners: Floats, *, num_planes: int) -> Floats:
    """(m, 3) points whose convex hull contains (n, 3, 3) triangles, at least one.

    Args:
        num_planes: Number of normals that the points will be multiplied with.
    """
    points = corners.reshape(-1, 3)
    if num_planes * len(points) <= _MAX_PRODUCTS:
        return np.unique(points, axis=0)
    return np.array(list(product(*zip(*bounding_box(corners), strict=True))))


def _signed_light_distances(scene: SceneMesh, light: ShadowCastingLight) -> Floats:
    """(n,) signed distance of the light from each plane; a cosine for directional lights."""
    if isinstance(light, DirectionalLight):
        cosine: Floats = -matmul(scene.normals, np.asarray(light.direction))
        return cosine
    to_light = np.asarray(light.position_m) - scene.corners[:, 0]
    height: Floats = einsum("ni,ni->n", scene.normals, to_light)
    return height


def _plane_offsets(scene: SceneMesh, triangles: np.ndarray) -> Floats:
    normals = scene.normals.take(triangles, axis=0)
    offsets: Floats = einsum("ni,ni->n", normals, scene.corners[:, 0].take(triangles, axis=0))
    return offsets


# Corners this near a plane lie in the plane: sums of float64 coordinates differ by less.
_IN_PLANE_M = 1e-6
# A plane that contains the light occludes nothing: a distance, or a cosine for directional lights.
_MIN_LIGHT_DISTANCE = 1e-9


class LightShafts:
    """The casters of a scene in one light."""

    def __init__(self, scene: SceneMesh, light: ShadowCastingLight) -> None:
        self._scene = scene
        self._light = light
        corners, normals = scene.corners[scene.casts_shadows], scene.normals[scene.casts_shadows]
        height = einsum("ni,ni->n", normals, self._towards(corners[:, 0]))
        reaches = np.abs(height) > _MIN_LIGHT_DISTANCE
        self._corners = corners[reaches]
        # Turned away from the light: what the caster can hide lies in front.
        self._normals = -np.sign(height[reaches])[:, None] * normals[reaches]
        self._offsets = einsum("ni,ni->n", self._normals, self._corners[:, 0])

    def __len__(self) -> int:
        """Number of casters."""
        return len(self._corners)

    def can_be_hidden(self, receiver: int) -> bool:
        """Whether a triangle of the scene that faces the light is hidden anywhere."""
        corners, normal = self._scene.corners[receiver], self._scene.normals[receiver]
        is_in_front = (
            matmul(self._corners, normal).max(axis=1) - matmul(normal, corners[0]) > _IN_PLANE_M
        )
        hides = matmul(self._normals, corners.T).max(axis=1) - self._offsets > _IN_PLANE_M
        casters = self._corners[is_in_front & hides]
        if not len(casters):
            return False
        casters = casters[self._reach_into(corners[None], casters)]
        return bool(self._reach_into(casters, corners[None]).any()) if len(casters) else False

    def _towards(self, points: Floats) -> Floats:
        """(..., 3) vectors from points towards the light."""
        if isinstance(self._light, DirectionalLight):
            return np.broadcast_to(-np.asarray(self._light.direction), points.shape)
        return np.asarray(self._light.position_m) - points

    def _reach_into(self, shafts: Floats, triangles: Floats) -> np.ndarray:
        """(k,) whether triangles reach into the shafts of others, by the shafts' sides.

        Args:
            shafts: (k or 1, 3, 3) triangles between which and the light the shafts lie.
            triangles: (k or 1, 3, 3).
        """
        first, second = shafts, np.roll(shafts, -1, axis=1)
        third = np.roll(shafts, -2, axis=1)
        sides = np.cross(second - first, self._towards(first))
        length = np.linalg.norm(sides, axis=-1, keepdims=True)
        # A side of no area separates nothing.
        sides = np.divide(sides, length, out=np.zeros_like(sides), where=length > 0.0)
        inward = einsum("kei,kei->ke", sides, third - first)
        sides *= np.sign(inward)[..., None]
        offsets = einsum("kei,kei->ke", sides, first)
        reach = einsum("kei,kci->kec", sides, triangles).max(axis=-1) - offsets
        is_inside: np.ndarray = ((reach > _IN_PLANE_M) | (inward == 0.0)).all(axis=-1)
        return is_inside
