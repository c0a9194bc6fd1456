"""Lamps and suns in a picture: the pixel of each light that is in view, and its light in the image.

Directional lights have a direction and no distance, point lights a position. Both are points: a
light is in view or hidden, by the range of the pixel that it falls into, in both renderers. That
includes the own robot and all objects, and is half a pixel wrong at their edges. No reflection in a
surface of the scene is a source.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import hypot, matmul
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.effects import LightSource
from catoptra_server.world.objects import CameraState
from catoptra_server.world.shading import (
    MIN_LIGHT_DISTANCE_M,
    ShadowCastingLight,
    direction_to_light,
    shadow_casting_lights,
)
from catoptra_server.world.world_description import DirectionalLight, Light

# A lamp may touch the surface that it hangs from, whose range is that of a pixel's centre.
_NEARER = 0.98
# Radii at which the image's area per solid angle is computed; at others it is cut at the largest.
_NUM_RADII = 201


def find_light_sources(
    lights: Iterable[Light],
    camera: RadialCamera,
    camera_state: CameraState,
    range_m: npt.NDArray[np.float32],
) -> tuple[LightSource, ...]:
    """Lights in view of an exposure, by the (h, w) ranges of its pixels."""
    pose = camera_state.world_from_mirror
    found = []
    for light in shadow_casting_lights(lights):
        direction, (distance_m,) = direction_to_light(light, pose.translation[None])
        pixel, is_shown = camera.pixel_from_direction(matmul(direction, pose.rotation))
        u, v = pixel[0].tolist()
        if not is_shown[0] or not (0.0 <= u < camera.width_px and 0.0 <= v < camera.height_px):
            continue
        if float(range_m[int(v), int(u)]) < _NEARER * distance_m:
            continue
        irradiance = _irradiance(light, float(distance_m))
        if camera_state.fog is not None:
            irradiance = irradiance * camera_state.fog.transmittance(distance_m[None])
        found.append(LightSource((u, v), tuple(irradiance.tolist())))
    return tuple(found)


def _irradiance(light: ShadowCastingLight, distance_m: float) -> Floats:
    """(3,) irradiance of a surface that faces a light."""
    if isinstance(light, DirectionalLight):
        return np.array(light.irradiance)
    nearest_m = max(distance_m, MIN_LIGHT_DISTANCE_M)
    return np.array(light.intensity) / (nearest_m * nearest_m)


def source_light_px(source: LightSource, camera: RadialCamera) -> Floats:
    """(3,) sum of the radiance that a source brings into the image, over pixels."""
    offset = np.subtract(source.pixel, camera.centre_px)
    radius_px = np.minimum(hypot(offset[0], offset[1]), camera.rim_radius_px)
    area = np.minimum(_px2_per_steradian(camera, radius_px[None]), max_px2_per_steradian(camera))
    factor = math.pi * area * camera.relative_illumination(radius_px[None])
    return np.array(source.irradiance) * factor


def max_source_light_px(lights: Iterable[Light], camera: RadialCamera, viewpoint: Floats) -> float:
    """Bound of the light of all sources, `source_light_px`, of any colour, at a (3,) viewpoint."""
    total = 0.0
    for light in shadow_casting_lights(lights):
        distance_m = float(direction_to_light(light, viewpoint[None])[1][0])
        total += float(_irradiance(light, distance_m).max())
    return math.pi * total * max_px2_per_steradian(camera) if total else 0.0


@lru_cache(maxsize=8)
def max_px2_per_steradian(camera: RadialCamera) -> float:
    """Largest area of the image per solid angle."""
    radii_px = np.linspace(0.0, camera.rim_radius_px, _NUM_RADII)
    return float(_px2_per_steradian(camera, radii_px).max())


def _px2_per_steradian(camera: RadialCamera, radius_px: Floats) -> Floats:
    """Area of the image per solid angle at (n,) radii: r / sin(theta) dr / dtheta."""
    t = camera.t_from_radius_px(radius_px)
    slope_px = camera.radius_slope_px(t)
    sine = 2.0 * t / (1.0 + np.square(t))
    # On the axis r is slope_px theta.
    over_sine = np.where(sine > 0.0, radius_px / np.where(sine > 0.0, sine, 1.0), slope_px)
    area: Floats = over_sine * slope_px
    return area
