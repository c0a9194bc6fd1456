"""Largest visible loss of light by shadows: of the static scene once, of objects in each frame.

Each triangle has the irradiance of the lights that a surface could occlude, point lights from the
nearest point of the triangle's box, and the irradiance that remains without them. The triangle
whose encoded colour would change most decides; a texture may darken a triangle by any factor. A
dynamic object can occlude any light from any surface, and counts as white: at most lit by all
lights, at least by the dimmer half of the sky.

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
each other, so it is exact for the scene: some point of R is hidden or none. Boxes of casters that
do not reach into the shaft are left out: the time of a test follows from what is near the shaft.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np

from catoptra_protocol.optics.elementary import einsum, hypot, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.effects import NO_SHADOW_LOSS, UNCHANGED, Gains, ShadowLoss
from catoptra_server.effects.bounds.coordinate_rounding import round_down
from catoptra_server.effects.bounds.light_loss import (
    grey_level_change,
    least_sky,
    max_irradiance,
    max_visible_loss,
    visible_losses,
)
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import (
    MIN_LIGHT_DISTANCE_M,
    ShadowCastingLight,
    hemisphere_lights,
    point_lights,
    shadow_casting_lights,
)
from catoptra_server.world.shapes import bounding_box
from catoptra_server.world.triangles import Indices, row_blocks
from catoptra_server.world.world_description import DirectionalLight, PointLight, World

# Triangles tested at once: the first, and at most. Most often the first ones are hidden.
_FIRST_CHUNK, _MAX_CHUNK = 16, 1024
# Pairs of a triangle and a box that are tested; all other triangles count as hidden. Those tested
# at once, and as many as NumPy's overhead takes the time of.
_MAX_PAIRS, _PAIRS_AT_ONCE, _PAIRS_PER_STEP = 1_000_000, 4096, 1000
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
        cache = lru_cache(maxsize=_CACHE_SIZE)
        self._find_darkest = cache(self._find_darkest_with_objects)
        self._find_static, self._find_full = cache(self._static_shadow), cache(self._full_shadow)

    def darkest_shadow(
        self, objects: tuple[DynamicObject, ...], gains: Gains = UNCHANGED
    ) -> ShadowLoss:
        """Largest visible loss by any shadow that the scene or dynamic objects could cast.

        Args:
            objects: Dynamic objects.
            gains: Factors from the scene's light to that of the finished picture.
        """
        if not self._lights:
            return NO_SHADOW_LOSS
        if not objects:
            return self._find_static(gains)
        # Rounded: a moving object rarely changes the summary, by which decisions are cached.
        nearest_m = round_down(_min_distance_m(light, objects) for light in self._point_lights)
        return self._find_darkest(nearest_m, gains)

    def _static_shadow(self, gains: Gains) -> ShadowLoss:
        """Most visible loss of any triangle by shadows of the static scene on itself."""
        candidates = np.array([_shadow_candidates(self._scene, light) for light in self._lights])
        # Triangles in order of what each could lose at most.
        potential = self._max_losses(candidates, gains)
        order = np.argsort(-potential, kind="stable")
        shafts = [LightShafts(self._scene, light) for light in self._lights]
        pairs_left, worst, count = _MAX_PAIRS, NO_SHADOW_LOSS, _FIRST_CHUNK
        while len(order) and potential[order[0]] > grey_level_change(worst):
            rows, order, count = order[:count], order[count:], min(2 * count, _MAX_CHUNK)
            hidden = candidates[:, rows]
            for of_light, shaft in zip(hidden, shafts, strict=True):
                of_light[of_light], pairs_left = shaft.find_hidden(rows[of_light], pairs_left)
            if pairs_left <= 0:
                # The rest counts as hidden, and loses no more than the next one.
                rows = np.append(rows, order[:1])
                hidden = np.append(hidden, candidates[:, order[:1]], axis=1)
                order = order[:0]
            worst = max(worst, self._max_loss(rows, hidden, gains), key=grey_level_change)
        return worst

    def _full_shadow(self, gains: Gains) -> ShadowLoss:
        """Loss of a scene whose every surface loses every light, as objects anywhere could
        cause."""
        everywhere = np.ones((len(self._lights), len(self._scene)), dtype=bool)
        worst = np.argsort(-self._max_losses(everywhere, gains), kind="stable")[:1]
        return self._max_loss(worst, everywhere[:, worst], gains)

    def _dimmest_sky(self) -> Floats:
        """(3,) least irradiance of all hemisphere lights on any facet."""
        # The less remains, the steeper the sRGB curve: the smaller irradiance is the safe one.
        darker = [
            np.minimum(sky.up_irradiance, sky.down_irradiance) for sky in self._hemisphere_lights
        ]
        total: Floats = np.sum(darker, axis=0) if darker else np.zeros(3)
        return total

    def _max_losses(self, can_be_lost: Bools, gains: Gains) -> Floats:
        """(n,) most visible losses of all triangles, grey levels, by (l, n) lights."""
        losses = np.zeros(len(self._scene))
        for block in row_blocks(len(losses)):
            radiances = self._lose(block, can_be_lost[:, block])
            varies = self._scene.has_varying_albedo(block)
            losses[block] = visible_losses(*radiances, can_be_darker=varies, gains=gains)
        return losses

    def _max_loss(self, rows: Indices, is_lost: Bools, gains: Gains) -> ShadowLoss:
        """Most visible loss of any of (m,) triangles by (l, m) lights."""
        varies = self._scene.has_varying_albedo(rows)
        return max_visible_loss(*self._lose(rows, is_lost), can_be_darker=varies, gains=gains)

    def _lose(self, rows: slice | Indices, is_lost: Bools) -> tuple[Floats, Floats]:
        """(m, 3) largest radiance that triangles lose by (l, m) lights, and least that remains."""
        scene = self._scene
        remaining = least_sky(scene, self._hemisphere_lights, rows)
        # What the scene hides of the sky is dark already.
        remaining = scene.smallest_sky_factors(rows) * remaining
        lost = np.zeros_like(remaining)
        for light, is_hidden in zip(self._lights, is_lost, strict=True):
            irradiance = max_irradiance(scene, light, rows)
            if isinstance(light, DirectionalLight):
                # A point light's irradiance is an upper bound, so only a directional light may
                # count as remaining.
                is_lost_too = is_hidden if scene.bent is None else is_hidden | scene.bent[rows]
                remaining += np.where(is_lost_too[:, None], 0.0, irradiance)
            lost += np.where(is_hidden[:, None], irradiance, 0.0)
        lit = scene.max_albedo(rows) * ~scene.unlit[rows, None]
        return lost * lit, remaining * lit

    def _find_darkest_with_objects(self, nearest_m: tuple[float, ...], gains: Gains) -> ShadowLoss:
        """Largest loss of the scene, or of white objects at any orientation.

        Args:
            nearest_m: Distance of the objects from each point light.
            gains: Factors from the scene's light to that of the finished picture.
        """
        remaining, lost = self._dimmest_sky(), np.zeros(3)
        for light in self._lights:
            if isinstance(light, DirectionalLight):
                lost += np.asarray(light.irradiance)
        for light, nearest in zip(self._point_lights, nearest_m, strict=True):
            lost += np.asarray(light.intensity) / max(
                nearest * nearest, MIN_LIGHT_DISTANCE_M * MIN_LIGHT_DISTANCE_M
            )
        of_objects = max_visible_loss(
            lost[None], remaining[None], can_be_darker=np.array([True]), gains=gains
        )
        return max((self._find_full(gains), of_objects), key=grey_level_change)


def _min_distance_m(light: PointLight, objects: tuple[DynamicObject, ...]) -> float:
    position = np.asarray(light.position_m)
    return min(hypot(*(position - one.centre)) - one.mesh.radius_m for one in objects)


# A tenth of a second; beyond, a box stands for the corners.
_MAX_PRODUCTS = 10**7
_NUM_PROBED_TRIANGLES = 500


def _shadow_candidates(scene: SceneMesh, light: ShadowCastingLight) -> Bools:
    """(n,) triangles that the light faces and a surface of the scene might occlude."""
    height = _signed_light_distances(scene, light)
    # Unlit and black surfaces look the same in a shadow.
    facing = (height > 0.0) & ~scene.unlit & np.logical_or.reduce(scene.albedo.T != 0.0)
    num_facing = int(np.count_nonzero(facing))
    casters = _extreme_points(scene.corners, scene.casts_shadows, num_planes=num_facing)
    for block in row_blocks(len(scene)):
        facing[block] &= _reach_planes(scene.normals[block], scene.corners[block, 0], casters)
    is_separated = _has_separating_plane(scene, height, facing)
    found: Bools = facing if is_separated else np.zeros_like(facing)
    # By normals that are not the facets', anything may turn towards the light.
    return found if scene.bent is None else found | scene.bent


def _has_separating_plane(scene: SceneMesh, height: Floats, receivers: Bools) -> bool:
    """Whether the plane of some caster separates the light from a corner of (n,) receivers.

    Args:
        scene: Triangles.
        height: (n,) signed distances of the light from their planes.
        receivers: (n,) triangles that might be occluded.
    """
    casters = np.flatnonzero(scene.casts_shadows & (np.abs(height) > _MIN_LIGHT_DISTANCE))
    points = _extreme_points(scene.corners, receivers, num_planes=len(casters))
    # In most scenes a sample of the triangles already has such a plane.
    sample = slice(None, None, 1 + len(casters) // _NUM_PROBED_TRIANGLES)
    rows = (casters[part] for part in (sample, *row_blocks(len(casters))))
    # Normals turned away from the light: a receiver's corner then lies in front of the plane.
    return any(
        _reach_planes(
            -np.sign(height[some])[:, None] * scene.normals[some], scene.corners[some, 0], points
        ).any()
        for some in rows
    )


def _extreme_points(corners: Floats, mask: Bools, *, num_planes: int) -> Floats:
    """(m, 3) points whose convex hull contains those of (n, 3, 3) triangles in a mask.

    Args:
        corners: Triangles.
        mask: (n,) triangles that count.
        num_planes: Number of planes that the points will be compared with.
    """
    if num_planes * 3 * int(np.count_nonzero(mask)) <= _MAX_PRODUCTS:
        return np.unique(corners[mask].reshape(-1, 3), axis=0)
    # A copy of a million triangles takes a tenth of a second.
    boxes = [bounding_box(corners[block][mask[block]]) for block in row_blocks(len(corners))]
    low, high = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
    return np.array(list(product(*zip(low, high, strict=True))))


def _reach_planes(normals: Floats, on_planes: Floats, points: Floats) -> Bools:
    """(k,) whether any of (m, 3) points lies in front of planes with (k, 3) normals and points."""
    # Points first: a maximum along a short last axis takes ten times as long.
    farthest = (matmul(points, normals.T)).max(axis=0, initial=-np.inf)
    is_passed: Bools = farthest - einsum("ki,ki->k", normals, on_planes) > _IN_PLANE_M
    return is_passed


def _signed_light_distances(scene: SceneMesh, light: ShadowCastingLight) -> Floats:
    """(n,) signed distance of the light from each plane; a cosine for directional lights."""
    if isinstance(light, DirectionalLight):
        cosine: Floats = -matmul(scene.normals, np.asarray(light.direction))
        return cosine
    to_light = np.asarray(light.position_m) - scene.corners[:, 0]
    height: Floats = einsum("ni,ni->n", scene.normals, to_light)
    return height


# Corners this near a plane lie in the plane: sums of float64 coordinates differ by less.
_IN_PLANE_M = 1e-6
# A plane that contains the light occludes nothing: a distance, or a cosine for directional lights.
_MIN_LIGHT_DISTANCE = 1e-9


class LightShafts:
    """The casters of a scene in one light."""

    def __init__(self, scene: SceneMesh, light: ShadowCastingLight) -> None:
        self._scene = scene
        self._light = light
        self._triangles = scene.hierarchy()

    def find_hidden(self, receivers: Indices, max_pairs: int) -> tuple[Bools, int]:
        """Triangles that are hidden anywhere.

        Args:
            receivers: (k,) triangles of the scene that face the light.
            max_pairs: Number of pairs after which the rest counts as hidden.

        Returns:
            (k,) whether each is hidden, and the number of pairs that is left.
        """
        hidden = np.zeros(len(receivers), dtype=bool)
        corners, normals = self._scene.corners[receivers], self._scene.normals[receivers]
        sides, offsets = self._find_sides(corners)
        # In front of the receiver, and within the shaft.
        planes = np.concatenate((normals[:, None], sides), axis=1)
        offsets = np.column_stack((einsum("ki,ki->k", normals, corners[:, 0]), offsets))
        top = len(self._triangles.levels) - 1
        roots = np.indices((len(receivers), self._triangles.levels[top].shape[1])).reshape(2, -1)
        pending = [(top, *roots)]
        while pending:
            level, receiver, boxes = pending.pop()
            is_open = ~hidden[receiver]
            receiver, boxes = receiver[is_open], boxes[is_open]
            if max_pairs <= 0:
                hidden[receiver] = True
                continue
            if len(boxes) > _PAIRS_AT_ONCE:
                pending.append((level, receiver[_PAIRS_AT_ONCE:], boxes[_PAIRS_AT_ONCE:]))
                receiver, boxes = receiver[:_PAIRS_AT_ONCE], boxes[:_PAIRS_AT_ONCE]
            max_pairs -= _PAIRS_PER_STEP + len(boxes)
            reach = _reach_of_boxes(self._triangles.levels[level][:6, boxes], planes[receiver])
            is_met = (reach > offsets[receiver]).all(axis=1)
            receiver, boxes = receiver[is_met], boxes[is_met]
            if level > 0:
                parents, boxes = self._triangles.children(level, boxes)
                pending.append((level - 1, receiver[parents], boxes))
            else:
                rows = self._triangles.rows(boxes)
                max_pairs -= rows.size
                receiver = np.repeat(receiver, rows.shape[1])
                hidden[self._select_hidden(receivers, receiver, rows.ravel())] = True
        return hidden, max_pairs

    def _select_hidden(self, receivers: Indices, receiver: Indices, rows: Indices) -> Indices:
        """Those of (p,) positions among receivers that the casters at (p,) rows hide."""
        order = self._triangles.order
        triangles = rows if order is None else order[rows]
        is_kept = self._scene.casts_shadows[triangles]
        receiver, triangles = receiver[is_kept], triangles[is_kept]
        of_receivers = receivers[receiver]
        casters, away = self._scene.corners[triangles], self._scene.normals[triangles]
        height = einsum("pi,pi->p", away, self._towards(casters[:, 0]))
        # Turned away from the light: what the caster can hide lies in front.
        away = -np.sign(height)[:, None] * away
        shaded, normals = self._scene.corners[of_receivers], self._scene.normals[of_receivers]
        is_kept = np.abs(height) > _MIN_LIGHT_DISTANCE
        is_kept &= _reach_above(casters, normals, shaded) & _reach_above(shaded, away, casters)
        receiver, casters, shaded = receiver[is_kept], casters[is_kept], shaded[is_kept]
        is_kept = self._reach_into(shaded, casters)
        receiver, casters, shaded = receiver[is_kept], casters[is_kept], shaded[is_kept]
        return receiver[self._reach_into(casters, shaded)]

    def _towards(self, points: Floats) -> Floats:
        """(..., 3) vectors from points towards the light."""
        if isinstance(self._light, DirectionalLight):
            return np.broadcast_to(-np.asarray(self._light.direction), points.shape)
        return np.asarray(self._light.position_m) - points

    def _reach_into(self, shafts: Floats, triangles: Floats) -> Bools:
        """(k,) whether (k, 3, 3) triangles reach into the shafts of others, by their sides."""
        sides, offsets = self._find_sides(shafts)
        reach = einsum("kei,kci->kec", sides, triangles).max(axis=-1)
        is_inside: Bools = (reach - offsets > _IN_PLANE_M).all(axis=-1)
        return is_inside

    def _find_sides(self, triangles: Floats) -> tuple[Floats, Floats]:
        """Sides of the shafts between (k, 3, 3) triangles and the light.

        Returns:
            (k, 3, 3) unit normals, inward, and (k, 3) offsets of the planes.
        """
        first, second = triangles, np.roll(triangles, -1, axis=1)
        third = np.roll(triangles, -2, axis=1)
        sides = np.cross(second - first, self._towards(first))
        length = np.linalg.norm(sides, axis=-1, keepdims=True)
        sides = np.divide(sides, length, out=np.zeros_like(sides), where=length > 0.0)
        inward = einsum("kei,kei->ke", sides, third - first)
        sides *= np.sign(inward)[..., None]
        # A side of no area separates nothing.
        offsets = np.where(inward == 0.0, -np.inf, einsum("kei,kei->ke", sides, first))
        return sides, offsets


def _reach_above(triangles: Floats, normals: Floats, others: Floats) -> Bools:
    """(p,) whether (p, 3, 3) triangles reach before the planes of others with (p, 3) normals."""
    reach = einsum("pci,pi->pc", triangles, normals).max(axis=1)
    is_above: Bools = reach - einsum("pi,pi->p", normals, others[:, 0]) > _IN_PLANE_M
    return is_above


def _reach_of_boxes(boxes: Floats, directions: Floats) -> Floats:
    """(p, d) largest products of the points in (6, p) boxes with (p, d, 3) directions."""
    low, high = boxes[:3].T, -boxes[3:].T
    centre = einsum("pdi,pi->pd", directions, 0.5 * (low + high))
    reach: Floats = centre + einsum("pdi,pi->pd", np.abs(directions), 0.5 * (high - low))
    return reach
