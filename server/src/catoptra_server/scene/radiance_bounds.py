"""The brightest light that a scene can show: a bound, found once, for the criteria of effects.

Facets count with all their light, textures as white, point lights from the nearest place of a
facet's box. Robots count as white facets under sky and sun; one that is nearer to a lamp than every
surface of the scene may be brighter than is said here.
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.shading import facet_radiance, point_lights
from catoptra_server.scene.world_description import (
    DirectionalLight,
    HemisphereLight,
    PointLight,
    World,
)

# As near as shading lets a light come, squared metres.
_MIN_DISTANCE_SQUARED_M2 = 1e-6


def max_radiance(scene: SceneMesh, world: World) -> float:
    """Return the brightest light of any colour: a tenth of a second for a million triangles."""
    radiance = facet_radiance(scene, world.lights) + _max_point_light_radiance(scene, world)
    largest = max(
        *world.background, float(radiance.max(initial=0.0)), _max_white_facet_radiance(world)
    )
    return largest


def _max_point_light_radiance(scene: SceneMesh, world: World) -> Floats:
    """Return (n, 3): at most what point lights add to each triangle."""
    total = np.zeros_like(scene.albedo)
    for light in point_lights(world.lights):
        total += max_point_irradiance(scene.corners, light)[0]
    return scene.albedo * np.where(scene.unlit[:, None], 0.0, total)


def max_point_irradiance(corners: Floats, light: PointLight) -> tuple[Floats, Floats]:
    """Return (n, 3): at most what a point light gives triangles, and (n,) from how near, metres.

    corners: (n, 3, 3). Near is the nearest place of a triangle's box.
    """
    low, high = corners.min(axis=1), corners.max(axis=1)
    at = np.asarray(light.position_m)
    outside = np.maximum(np.maximum(low - at, at - high), 0.0)
    squared = np.maximum(np.square(outside).sum(axis=-1), _MIN_DISTANCE_SQUARED_M2)
    irradiance: Floats = np.asarray(light.intensity) / squared[:, None]
    return irradiance, np.sqrt(squared)


def _max_white_facet_radiance(world: World) -> float:
    """Return at most what sky and sun give a white facet, however it is turned."""
    total = np.zeros(3)
    for light in world.lights:
        match light:
            case HemisphereLight(up, down):
                total += np.maximum(up, down)
            case DirectionalLight(_, irradiance):
                total += np.asarray(irradiance)
    return float(total.max())
