"""Light of a scene: bounds of radiance and irradiance, the loss that an image would show, culling.

A loss is in encoded grey levels, since the sRGB curve is 13 times as steep in the dark as at white:
the largest linear loss is rarely the largest visible one. The worst of many surfaces counts.

Lights below visibility are culled. For each light the largest irradiance on any triangle is
bounded: none on back faces, the inverse square from the nearest point of the triangle's box, at
most the cosine from there. Lights that together change no triangle's colour by more than
MAX_CULLED_GREY_LEVELS are dropped with a log line: too far, too dim, or behind every facet. Dynamic
objects move and turn, so they keep all lights.

Bounds of radiance and irradiance, by branch and bound over the facets: every facet first counts
with all its light, a texture with its brightest texel of each colour, and a point light from the
nearest point of a sphere about the facet. The few facets that may be the brightest then count by
the boxes of their pieces, cut in four until no piece may be a tenth brighter than a point of the
scene is: four lamps over one large floor do not all stand over the same point of it. 30 ms for a
million triangles, and 20 ms more for each point light.

A dynamic object counts with its own brightest colour, turned towards all lights, and with point
lights from the nearest point of its bounding sphere.
"""

from __future__ import annotations

import logging
from collections.abc import Collection
from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import einsum, hypot, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.effects import NO_SHADOW_LOSS, UNCHANGED, Gains, ShadowLoss
from catoptra_server.effects.kernels.grey_levels import grey_level
from catoptra_server.world.objects import DynamicObject, ObjectMesh
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import (
    MIN_LIGHT_DISTANCE_M,
    ShadowCastingLight,
    facet_irradiance,
    hemisphere_lights,
    point_irradiance,
    point_lights,
    shadow_casting_lights,
)
from catoptra_server.world.triangles import row_blocks
from catoptra_server.world.world_description import (
    DirectionalLight,
    HemisphereLight,
    Light,
    PointLight,
    World,
    linear_from_srgb,
    srgb_from_linear,
)

log = logging.getLogger(__name__)
_Rows = slice | npt.NDArray[np.intp]


def max_radiance(scene: SceneMesh, world: World) -> float:
    """Largest radiance in any colour channel, the background's included.

    Visibility and shadows do not count, nor which texel lies where.
    """
    facets = _Facets(scene, world)
    of_blocks = [facets.bound_roughly(block) for block in row_blocks(len(scene))]
    bounds = np.concatenate([np.zeros(0), *of_blocks])
    background = max(world.background_range[1])
    if not facets.lamps:
        return max(background, float(bounds.max(initial=0.0)))
    return max(background, _refine(facets, bounds, background))


# Time between the pose of an exposure and its begin or end.
_MAX_OFFSET_S = 0.1


class ObjectRadiances:
    """Largest radiances of dynamic objects in one world."""

    def __init__(self, world: World) -> None:
        self._probes = world.probes
        if world.probes is not None:
            world = replace(world, lights=shadow_casting_lights(world.lights))
        self._irradiance = _max_irradiance_of_any_facet(world)
        lamps = point_lights(world.lights)
        self._positions_m = np.array([lamp.position_m for lamp in lamps]).reshape(-1, 3)
        self._intensities = np.array([lamp.intensity for lamp in lamps]).reshape(-1, 3)
        # Per instance: without a point light, all objects of a mesh have one bound.
        self._find_of_mesh = lru_cache(maxsize=64)(self._find_without_lamps)

    def max_radiance(self, objects: Collection[DynamicObject]) -> float:
        """Largest radiance of any object around its pose, in any colour channel; 0 without objects.

        Domain: exposures of at most a fifth of a second, in which a moving object nears a lamp.
        """
        if not len(self._positions_m) and self._probes is None:
            return max(map(self._find_of_mesh, {one.mesh for one in objects}), default=0.0)
        if not objects:
            return 0.0
        # All at once: a few operations, however many objects and lamps there are.
        offsets = np.array([one.centre for one in objects])[:, None] - self._positions_m
        reach_m = [
            one.mesh.radius_m + _MAX_OFFSET_S * hypot(*one.twist.linear_m_s) for one in objects
        ]
        nearest_m = np.linalg.norm(offsets, axis=-1) - np.array(reach_m)[:, None]
        factors = 1.0 / np.square(np.maximum(nearest_m, MIN_LIGHT_DISTANCE_M))
        unlit, lit = np.array([_max_albedos(one.mesh) for one in objects]).transpose(1, 0, 2)
        irradiance = np.repeat(self._irradiance[None], len(objects), axis=0)
        if factors.size:
            irradiance += matmul(factors, self._intensities)
        if self._probes is not None:
            irradiance += [self._probes.find_light(one.centre).largest for one in objects]
        return float(np.maximum(unlit, lit * irradiance).max())

    def _find_without_lamps(self, mesh: ObjectMesh) -> float:
        unlit, lit = _max_albedos(mesh)
        return float(np.maximum(unlit, lit * self._irradiance).max())


@lru_cache(maxsize=64)
def _max_albedos(mesh: ObjectMesh) -> tuple[Floats, Floats]:
    """(3,) largest albedo of unlit and of lit facets; 0 without any."""
    unlit, lit = mesh.albedo[mesh.unlit], mesh.albedo[~mesh.unlit]
    return unlit.max(axis=0, initial=0.0), lit.max(axis=0, initial=0.0)


def _max_irradiance_of_any_facet(world: World) -> Floats:
    """(3,) largest irradiance of a facet at any orientation, but for point lights."""
    total = np.zeros(3)
    for light in world.lights:
        match light:
            case HemisphereLight(up, down):
                total += np.maximum(up, down)
            case DirectionalLight(_, irradiance):
                total += np.asarray(irradiance)
    return total


def max_irradiance(scene: SceneMesh, light: ShadowCastingLight, rows: _Rows) -> Floats:
    """(m, 3) largest irradiance by a light on some triangles of a scene."""
    bent = None if scene.bent is None else scene.bent[rows]
    if isinstance(light, PointLight):
        return max_facet_irradiance(scene.corners[rows], scene.normals[rows], light, bent)
    irradiance = facet_irradiance((light,), scene.normals[rows])
    return irradiance if bent is None else np.where(bent[:, None], light.irradiance, irradiance)


def least_sky(scene: SceneMesh, skies: tuple[HemisphereLight, ...], rows: _Rows) -> Floats:
    """(m, 3) least irradiance of hemisphere lights on some triangles, nothing hidden."""
    irradiance = facet_irradiance(skies, scene.normals[rows])
    if scene.bent is None:
        return irradiance
    darker = [np.minimum(sky.up_irradiance, sky.down_irradiance) for sky in skies]
    least: Floats = np.sum(darker, axis=0) if darker else np.zeros(3)
    return np.where(scene.bent[rows, None], least, irradiance)


def max_facet_irradiance(
    corners: Floats, normals: Floats, light: PointLight, bent: Bools | None = None
) -> Floats:
    """(n, 3) largest irradiance by a point light on (n, 3, 3) triangles with (n, 3) normals.

    At (n,) bent ones points may have any normals.
    """
    # Coordinates first: a minimum of three along an axis takes ten times as long.
    first, second, third = np.moveaxis(corners - np.asarray(light.position_m), 0, -1)
    low = np.minimum(np.minimum(first, second), third)
    high = np.maximum(np.maximum(first, second), third)
    # The nearest point of a box needs no case distinction, and is never farther than the
    # triangle's.
    outside = np.maximum(np.maximum(low, -high), 0.0)
    nearest_m = np.sqrt(np.square(outside).sum(axis=0))
    # The irradiance I h / d^3 of a facet grows towards the lamp, whose height above its plane is
    # the same all over it, and no greater than any distance.
    height_m = np.maximum(-einsum("ni,in->n", normals, first), 0.0)
    if bent is not None:
        height_m = np.where(bent, np.maximum(nearest_m, MIN_LIGHT_DISTANCE_M), height_m)
    distance_m = np.maximum(np.maximum(nearest_m, height_m), MIN_LIGHT_DISTANCE_M)
    irradiance: Floats = (
        np.asarray(light.intensity) * (height_m / (distance_m * distance_m * distance_m))[:, None]
    )
    return irradiance


# A bound this much above a radiance that the scene has is close enough.
_CLOSE = 1.1
# Rough bounds are rounded by less.
_ROUNDED = 1.0 - 1e-6
# Pieces of all facets together: 10 ms.
_MAX_PIECES = 4096
# Halvings of a facet's edges: pieces of a hall's floor are then a hand wide.
_MAX_ROUNDS = 10
# Facets whose radiance is evaluated, since their bounds are the largest.
_EVALUATED = 64


def _refine(facets: _Facets, bounds: Floats, known: float) -> float:
    """Largest radiance of any facet, by (n,) rough bounds; `known` is one that the scene has."""
    brightest = _find_brightest(bounds)
    known = max(known, facets.evaluate(brightest, facets.scene.corners[brightest]))
    index = np.flatnonzero(bounds > _ROUNDED * known)
    corners = facets.scene.corners[index]
    if len(index) > _MAX_PIECES:
        # Many facets of one brightness: their own boxes say as much as pieces' would.
        of_blocks = (facets.bound(index[block], corners[block]) for block in row_blocks(len(index)))
        return max(float(one.max()) for one in of_blocks)
    bounds = facets.bound(index, corners)
    settled = known
    for _ in range(_MAX_ROUNDS):
        brightest = _find_brightest(bounds)
        known = max(known, facets.evaluate(index[brightest], corners[brightest]))
        is_open = bounds > _CLOSE * known
        settled = max(settled, float(bounds[~is_open].max(initial=0.0)))
        index, corners, bounds = index[is_open], corners[is_open], bounds[is_open]
        if not len(index) or 4 * len(index) > _MAX_PIECES:
            break
        index, corners = np.repeat(index, 4), _quarter(corners)
        # A piece is no brighter than the whole.
        bounds = np.minimum(np.repeat(bounds, 4), facets.bound(index, corners))
    return max(settled, float(bounds.max(initial=0.0)))


def _find_brightest(bounds: Floats) -> npt.NDArray[np.intp]:
    """Indices of the largest bounds, in no order."""
    if len(bounds) <= _EVALUATED:
        return np.arange(len(bounds))
    return np.argpartition(bounds, -_EVALUATED)[-_EVALUATED:]


def _quarter(corners: Floats) -> Floats:
    """(4 n, 3, 3) triangles between corners and edge centres of (n, 3, 3) triangles."""
    a, b, c = np.moveaxis(corners, 1, 0)
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (bc, ca, ab))
    quarters: Floats = np.stack([np.stack(part, axis=1) for part in parts], axis=1)
    return quarters.reshape(-1, 3, 3)


class _Facets:
    """Facets of a scene under its lights."""

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self.scene = scene
        self.lamps: tuple[PointLight, ...] = tuple(point_lights(world.lights))
        self._lights = world.lights
        self._any = _max_irradiance_of_any_facet(world)
        # Index -1, of facets without a texture, is the last row.
        # Axis by axis: a hundredth of the time of both at once.
        columns = (texture.max(axis=0)[:, :3] for texture in scene.textures)
        brightest = [column.max(axis=0) / 255.0 for column in columns]
        self._texels = linear_from_srgb(np.array([*brightest, np.ones(3)]))

    def bound_roughly(self, block: slice) -> Floats:
        """(m,) largest radiance of each of some triangles, by spheres about their first corners.

        To rounding by the size of the scene.
        """
        normals = self.scene.normals[block]
        if not self.lamps:
            return self._reflect(block, np.zeros_like(normals))
        corners = self.scene.corners[block]
        first = corners[:, 0]
        edges = (corners[:, 1] - first, corners[:, 2] - first)
        reach_m = np.sqrt(np.maximum(*(einsum("ni,ni->n", edge, edge) for edge in edges)))
        # (m, lamps), by products of matrices: differences of all vectors take three times as long.
        position = np.array([lamp.position_m for lamp in self.lamps]).T
        height_m = matmul(normals, position) - einsum("ni,ni->n", normals, first)[:, None]
        np.maximum(height_m, 0.0, out=height_m)
        squared_m2 = np.square(position).sum(axis=0) - 2.0 * matmul(first, position)
        squared_m2 += einsum("ni,ni->n", first, first)[:, None]
        nearest_m = np.sqrt(np.maximum(squared_m2, 0.0, out=squared_m2), out=squared_m2)
        nearest_m -= reach_m[:, None]
        if self.scene.bent is not None:
            near = np.maximum(nearest_m, MIN_LIGHT_DISTANCE_M)
            height_m = np.where(self.scene.bent[block, None], near, height_m)
        distance_m = np.maximum(np.maximum(nearest_m, height_m), MIN_LIGHT_DISTANCE_M)
        factor = height_m / (distance_m * distance_m * distance_m)
        return self._reflect(
            block, matmul(factor, np.array([lamp.intensity for lamp in self.lamps]))
        )

    def bound(self, index: npt.NDArray[np.intp], corners: Floats) -> Floats:
        """(m,) largest radiance of (m, 3, 3) pieces of triangles, by their boxes."""
        normals = self.scene.normals[index]
        irradiance = np.zeros_like(normals)
        bent = None if self.scene.bent is None else self.scene.bent[index]
        for lamp in self.lamps:
            irradiance += max_facet_irradiance(corners, normals, lamp, bent)
        return self._reflect(index, irradiance)

    def evaluate(self, index: npt.NDArray[np.intp], corners: Floats) -> float:
        """Largest radiance at the corners and centres of pieces, as bright as they are anywhere."""
        points = np.concatenate((corners, corners.mean(axis=1, keepdims=True)), axis=1)
        normals = np.repeat(self.scene.normals[index], 4, axis=0)
        irradiance = point_irradiance(self.lamps, points.reshape(-1, 3), normals)
        return float(self._reflect(np.repeat(index, 4), irradiance).max(initial=0.0))

    def _reflect(self, which: slice | npt.NDArray[np.intp], irradiance: Floats) -> Floats:
        """(m,) largest radiance of triangles by (m, 3) irradiance of lamps."""
        scene = self.scene
        total = facet_irradiance(self._lights, scene.normals[which])
        if scene.bent is not None:
            total = np.where(scene.bent[which, None], self._any, total)
        total = irradiance + total
        albedo = scene.max_albedo(which) * self._texels[scene.texture_index[which]]
        radiance: Floats = albedo * np.where(scene.unlit[which, None], 1.0, total)
        if scene.emission is not None:
            radiance += scene.emission[which]
        # By channel: a maximum along an axis of three takes ten times as long.
        return np.maximum(np.maximum(radiance[:, 0], radiance[:, 1]), radiance[:, 2])


def max_visible_loss(
    lost_radiance: Floats,
    remaining_radiance: Floats,
    *,
    can_be_darker: Bools,
    gains: Gains = UNCHANGED,
) -> ShadowLoss:
    """Radiance and colour channel of the finished picture that a loss changes most.

    Args:
        lost_radiance: (n, 3) linear radiance that each surface loses.
        remaining_radiance: (n, 3) radiance that remains.
        can_be_darker: (n,) surfaces whose texture may scale both by any factor below one.
        gains: Factors from the scene's light to the picture's.
    """
    if not lost_radiance.any():
        return NO_SHADOW_LOSS
    lost, remaining, change = _scale_to_white(
        lost_radiance, remaining_radiance, can_be_darker, gains
    )
    worst = np.unravel_index(int(np.argmax(change)), change.shape)
    return ShadowLoss(float(lost[worst]), float(remaining[worst]))


def visible_losses(
    lost_radiance: Floats, remaining_radiance: Floats, *, can_be_darker: Bools, gains: Gains
) -> Floats:
    """(n,) largest changes of the surfaces' channels, grey levels; arguments as above."""
    change = _scale_to_white(lost_radiance, remaining_radiance, can_be_darker, gains)[2]
    levels: Floats = 255.0 * change.max(axis=1)
    return levels


def grey_level_change(loss: ShadowLoss) -> float:
    """Change of the encoded image by a loss, grey levels."""
    return grey_level(loss.remaining_radiance + loss.lost_radiance) - grey_level(
        loss.remaining_radiance
    )


_LEAST_LIGHT = 1e-300


def _scale_to_white(
    lost_radiance: Floats, remaining_radiance: Floats, can_be_darker: Bools, gains: Gains
) -> tuple[Floats, Floats, Floats]:
    """(n, 3) lost and remaining radiance at the scale that shows most, and encoded changes."""
    # Above white a loss is clipped away: of all scales of a surface, by its texture and by what
    # follows, the one that just reaches white loses most.
    least = np.where(can_be_darker[:, None], 0.0, gains[0])
    to_white = 1.0 / np.maximum(lost_radiance + remaining_radiance, _LEAST_LIGHT)
    factor = np.clip(to_white, least, gains[1])
    lost_radiance, remaining_radiance = factor * lost_radiance, factor * remaining_radiance
    lit = lost_radiance + remaining_radiance
    change: Floats = srgb_from_linear(lit) - srgb_from_linear(remaining_radiance)
    return lost_radiance, remaining_radiance, change


# Sum over all culled lights: a tenth of the threshold of effects.
MAX_CULLED_GREY_LEVELS = 0.05
# A light that a sample of triangles already needs is kept without a look at the others.
_NUM_PROBED_TRIANGLES = 500


def cull_lights(
    scene: SceneMesh, lights: tuple[Light, ...], gains: Gains = UNCHANGED
) -> tuple[Light, ...]:
    """Lights of a world without those that change nothing visible of the static scene.

    Each culled light is logged with its bound.

    Args:
        scene: Triangles of the static scene.
        lights: Lights of its world.
        gains: Factors from the scene's light to that of any camera's picture.
    """
    changes = {
        light: _max_grey_level_change(scene, lights, light, gains)
        for light in shadow_casting_lights(lights)
    }
    culled: set[Light] = set()
    total = 0.0
    # Weakest first: the sum then stays below the limit for as many lights as possible.
    for light, change in sorted(changes.items(), key=lambda item: item[1]):
        total += change
        if total > MAX_CULLED_GREY_LEVELS:
            break
        culled.add(light)
        log.info("%s is culled: no surface changes by more than %.2g grey levels", light, change)
    return tuple(light for light in lights if light not in culled)


def _max_grey_level_change(
    scene: SceneMesh, lights: tuple[Light, ...], light: ShadowCastingLight, gains: Gains
) -> float:
    """Largest change of any triangle by a light, or any change above the limit."""
    step = max(len(scene) // _NUM_PROBED_TRIANGLES, 1)
    for part in (slice(None, None, step), slice(None)):
        change = _max_change_of_part(scene, lights, light, part, gains)
        if change > MAX_CULLED_GREY_LEVELS or step == 1:
            break
    return change


def _max_change_of_part(
    scene: SceneMesh,
    lights: tuple[Light, ...],
    light: ShadowCastingLight,
    part: slice,
    gains: Gains,
) -> float:
    albedo = scene.max_albedo(part) * ~scene.unlit[part, None]
    sky = least_sky(scene, hemisphere_lights(lights), part)
    remaining = albedo * scene.smallest_sky_factors(part) * sky
    lost = albedo * max_irradiance(scene, light, part)
    # The albedo of a point may be any fraction of the largest; the change is bounded for the worst.
    can_be_darker = scene.has_varying_albedo(part)
    return grey_level_change(
        max_visible_loss(lost, remaining, can_be_darker=can_be_darker, gains=gains)
    )
