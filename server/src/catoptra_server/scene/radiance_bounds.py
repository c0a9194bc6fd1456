"""Upper bounds of irradiance in a scene, and of the radiance of dynamic objects.

A point light counts from the nearest point of a facet's box. A dynamic object counts with its own
brightest colour, turned towards all lights, and with point lights from the nearest point of its
bounding sphere.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.scene.dynamic_object import DynamicObject, ObjectMesh
from catoptra_server.scene.shading import point_lights
from catoptra_server.scene.world_description import (
    DirectionalLight,
    HemisphereLight,
    PointLight,
    World,
)

MIN_DISTANCE_SQUARED_M2 = 1e-6
"""Shading clamps the squared distance of a point light to this as well."""
# Time between the pose of an exposure and its begin or end.
_MAX_OFFSET_S = 0.1


def max_object_radiance(dynamic_object: DynamicObject, world: World) -> float:
    """Largest radiance of a dynamic object around its pose, in any colour channel.

    Domain: exposures of at most a fifth of a second, in which a moving object nears a lamp.
    """
    irradiance = _max_irradiance_of_any_facet(world)
    for light in point_lights(world.lights):
        towards = np.asarray(light.position_m) - dynamic_object.centre
        reach_m = dynamic_object.mesh.radius_m + _MAX_OFFSET_S * dynamic_object.twist.speed_m_s
        nearest_m = max(0.0, float(np.linalg.norm(towards)) - reach_m)
        squared_m2 = max(nearest_m**2, MIN_DISTANCE_SQUARED_M2)
        irradiance = irradiance + np.asarray(light.intensity) / squared_m2
    unlit, lit = _max_albedos(dynamic_object.mesh)
    return float(np.maximum(unlit, lit * irradiance).max())


@lru_cache(maxsize=64)
def _max_albedos(mesh: ObjectMesh) -> tuple[Floats, Floats]:
    """(3,) largest albedo of unlit and of lit facets; 0 without any."""
    unlit, lit = mesh.albedo[mesh.unlit], mesh.albedo[~mesh.unlit]
    return unlit.max(axis=0, initial=0.0), lit.max(axis=0, initial=0.0)


def max_point_irradiance(corners: Floats, light: PointLight) -> tuple[Floats, Floats]:
    """Largest irradiance by a point light on triangles, at any orientation.

    Args:
        corners: (n, 3, 3) metres.

    Returns:
        (n, 3) irradiance, and (n,) metres from the light to the nearest point of each triangle's
            box.
    """
    low, high = corners.min(axis=1), corners.max(axis=1)
    position = np.asarray(light.position_m)
    # The nearest point of a box needs no case distinction, and is never farther than the
    # triangle's.
    outside = np.maximum(np.maximum(low - position, position - high), 0.0)
    squared = np.maximum(np.square(outside).sum(axis=-1), MIN_DISTANCE_SQUARED_M2)
    irradiance: Floats = np.asarray(light.intensity) / squared[:, None]
    return irradiance, np.sqrt(squared)


def max_facet_irradiance(corners: Floats, normals: Floats, light: PointLight) -> Floats:
    """(n, 3) largest irradiance by a point light on (n, 3, 3) triangles with (n, 3) normals."""
    nearest_m = max_point_irradiance(corners, light)[1]
    # The irradiance I h / d^3 of a facet grows towards the lamp, whose height above its plane is
    # the same all over it, and no greater than any distance.
    to_light = np.asarray(light.position_m) - corners[:, 0]
    height_m = np.maximum(np.einsum("ni,ni->n", normals, to_light), 0.0)
    distance_m = np.maximum(np.maximum(nearest_m, height_m), MIN_DISTANCE_SQUARED_M2**0.5)
    irradiance: Floats = np.asarray(light.intensity) * (height_m / distance_m**3)[:, None]
    return irradiance


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
