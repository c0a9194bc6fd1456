"""Lights that no surface of a scene would miss are left out of it before anything is drawn.

Of each light the most that it gives any triangle is bounded: nothing behind a facet, the inverse
square from the nearest place of its box, at most the cosine there. Those that change no triangle's
picture by more than NOTICED, all together, are dropped: they are too far, too dim, or shine on
backs alone. Bodies come anywhere and turn all ways: they keep all lights.
"""

from __future__ import annotations

import logging

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.bounds.radiance_loss import grey_level_change, max_visible_loss
from catoptra_server.scene import shading
from catoptra_server.scene.radiance_bounds import max_point_irradiance
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.shading import ShadowCastingLight
from catoptra_server.scene.world_description import Light, PointLight

log = logging.getLogger(__name__)

# Grey levels, of all that is dropped: a tenth of what effects may leave out, since an exposure that
# is ten times as long shows ten times as much in the dark, where the curve is straight.
MAX_CULLED_GREY_LEVELS = 0.05
# Where so many of the triangles show that a light is needed, the others are not asked.
_NUM_PROBED_TRIANGLES = 500


def cull_lights(scene: SceneMesh, lights: tuple[Light, ...]) -> tuple[Light, ...]:
    """Return the lights of a world without those that change nothing of a scene; log which."""
    changes = {
        light: _max_grey_level_change(scene, lights, light)
        for light in shading.shadow_casting_lights(lights)
    }
    dropped: set[Light] = set()
    total = 0.0
    for light, change in sorted(changes.items(), key=lambda item: item[1]):
        total += change
        if total > MAX_CULLED_GREY_LEVELS:
            break
        dropped.add(light)
        log.info("%s is left out: it changes no surface by more than %.2g levels", light, change)
    return tuple(light for light in lights if light not in dropped)


def _max_grey_level_change(
    scene: SceneMesh, lights: tuple[Light, ...], light: ShadowCastingLight
) -> float:
    """Return at most by how many grey levels a light changes any triangle, or more than enough."""
    step = max(len(scene) // _NUM_PROBED_TRIANGLES, 1)
    for part in (slice(None, None, step), slice(None)):
        change = _max_change_of_part(scene, lights, light, part)
        if change > MAX_CULLED_GREY_LEVELS or step == 1:
            break
    return change


def _max_change_of_part(
    scene: SceneMesh, lights: tuple[Light, ...], light: ShadowCastingLight, part: slice
) -> float:
    albedo = scene.albedo[part] * ~scene.unlit[part, None]
    left = albedo * shading.facet_irradiance(shading.hemisphere_lights(lights), scene.normals[part])
    lost = albedo * _max_irradiance(scene, light, part)
    can_be_darker = scene.texture_index[part] >= 0
    return grey_level_change(max_visible_loss(lost, left, can_be_darker=can_be_darker))


def _max_irradiance(scene: SceneMesh, light: ShadowCastingLight, part: slice) -> Floats:
    """Return (n, 3): at most what a light gives each triangle of a part."""
    normals, corners = scene.normals[part], scene.corners[part]
    if not isinstance(light, PointLight):
        return shading.facet_irradiance((light,), normals)
    height = np.einsum("ni,ni->n", normals, np.asarray(light.position_m) - corners[:, 0])
    irradiance, distance = max_point_irradiance(corners, light)
    cosine = np.clip(height / distance, 0.0, 1.0)
    reached: Floats = irradiance * cosine[:, None]
    return reached
