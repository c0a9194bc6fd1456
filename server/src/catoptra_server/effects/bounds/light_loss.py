"""Loss of light that an image would show, in encoded grey levels; lights that change nothing.

Encoded, since the sRGB curve is 13 times as steep in the dark as at white: the largest linear loss
is rarely the largest visible one. The worst of many surfaces counts.

Lights below visibility are culled. For each light the largest irradiance on any triangle is
bounded: none on back faces, the inverse square from the nearest point of the triangle's box, at
most the cosine from there. Lights that together change no triangle's colour by more than
MAX_CULLED_GREY_LEVELS are dropped with a log line: too far, too dim, or behind every facet. Dynamic
objects move and turn, so they keep all lights.
"""

from __future__ import annotations

import logging

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.effects.effect import NO_SHADOW_LOSS, ShadowLoss
from catoptra_server.effects.kernels.grey_levels import grey_level
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.scene_radiance import max_point_irradiance
from catoptra_server.world.shading import (
    ShadowCastingLight,
    facet_irradiance,
    hemisphere_lights,
    shadow_casting_lights,
)
from catoptra_server.world.world_description import Light, PointLight, srgb_from_linear

log = logging.getLogger(__name__)


def max_visible_loss(
    lost_radiance: Floats, remaining_radiance: Floats, *, can_be_darker: Bools
) -> ShadowLoss:
    """Radiance and colour channel that a loss changes most when encoded to sRGB.

    Args:
        lost_radiance: (n, 3) linear radiance that each surface loses.
        remaining_radiance: (n, 3) radiance that remains.
        can_be_darker: (n,) surfaces whose texture may scale both by any factor below one.
    """
    if not lost_radiance.any():
        return NO_SHADOW_LOSS
    lost, remaining, change = _scale_to_white(lost_radiance, remaining_radiance, can_be_darker)
    worst = np.unravel_index(int(np.argmax(change)), change.shape)
    return ShadowLoss(float(lost[worst]), float(remaining[worst]))


def visible_losses(
    lost_radiance: Floats, remaining_radiance: Floats, *, can_be_darker: Bools
) -> Floats:
    """(n,) largest changes of the surfaces' channels, grey levels; arguments as above."""
    change = _scale_to_white(lost_radiance, remaining_radiance, can_be_darker)[2]
    levels: Floats = 255.0 * change.max(axis=1)
    return levels


def grey_level_change(loss: ShadowLoss) -> float:
    """Change of the encoded image by a loss, grey levels."""
    return grey_level(loss.remaining_radiance + loss.lost_radiance) - grey_level(
        loss.remaining_radiance
    )


def _scale_to_white(
    lost_radiance: Floats, remaining_radiance: Floats, can_be_darker: Bools
) -> tuple[Floats, Floats, Floats]:
    """(n, 3) lost and remaining radiance at the scale that shows most, and encoded changes."""
    # Above white a loss is clipped away: of all scales of a textured surface, the one that just
    # reaches white loses most.
    factor = np.where(
        can_be_darker[:, None], 1.0 / np.maximum(lost_radiance + remaining_radiance, 1.0), 1.0
    )
    lost_radiance, remaining_radiance = factor * lost_radiance, factor * remaining_radiance
    lit = lost_radiance + remaining_radiance
    change: Floats = srgb_from_linear(lit) - srgb_from_linear(remaining_radiance)
    return lost_radiance, remaining_radiance, change


# Sum over all culled lights. A tenth of the threshold of effects: an exposure of ten times the
# light shows ten times the change in the dark, where the sRGB curve is straight.
MAX_CULLED_GREY_LEVELS = 0.05
# A light that a sample of triangles already needs is kept without a look at the others.
_NUM_PROBED_TRIANGLES = 500


def cull_lights(scene: SceneMesh, lights: tuple[Light, ...]) -> tuple[Light, ...]:
    """Lights of a world without those that change nothing visible of the static scene.

    Each culled light is logged with its bound.
    """
    changes = {
        light: _max_grey_level_change(scene, lights, light)
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
    scene: SceneMesh, lights: tuple[Light, ...], light: ShadowCastingLight
) -> float:
    """Largest change of any triangle by a light, or any change above the limit."""
    step = max(len(scene) // _NUM_PROBED_TRIANGLES, 1)
    for part in (slice(None, None, step), slice(None)):
        change = _max_change_of_part(scene, lights, light, part)
        if change > MAX_CULLED_GREY_LEVELS or step == 1:
            break
    return change


def _max_change_of_part(
    scene: SceneMesh, lights: tuple[Light, ...], light: ShadowCastingLight, part: slice
) -> float:
    albedo = scene.max_albedo(part) * ~scene.unlit[part, None]
    sky = facet_irradiance(hemisphere_lights(lights), scene.normals[part])
    remaining = albedo * scene.smallest_sky_factors(part)[:, None] * sky
    lost = albedo * _max_irradiance(scene, light, part)
    # The albedo of a point may be any fraction of the largest; the change is bounded for the worst.
    can_be_darker = scene.has_varying_albedo(part)
    return grey_level_change(max_visible_loss(lost, remaining, can_be_darker=can_be_darker))


def _max_irradiance(scene: SceneMesh, light: ShadowCastingLight, part: slice) -> Floats:
    """(n, 3) largest irradiance by a light on the triangles of a part."""
    normals, corners = scene.normals[part], scene.corners[part]
    if not isinstance(light, PointLight):
        return facet_irradiance((light,), normals)
    height = np.einsum("ni,ni->n", normals, np.asarray(light.position_m) - corners[:, 0])
    irradiance, distance = max_point_irradiance(corners, light)
    cosine = np.clip(height / distance, 0.0, 1.0)
    incident: Floats = irradiance * cosine[:, None]
    return incident
