"""A clear or clouded sky with its sun, from one integral of light scattered by the air.

Sunlight is scattered by molecules (Rayleigh) and haze (Mie); what the ground reflects is seen
through the same air. What is scattered more than once counts as light from all directions alike,
the mean of sky and ground: it makes horizons bright. Sun, sky and ground have one scale: a white
level surface under a sun of 45 degrees and a turbidity of 2 has 0.94. The sun itself is a
directional light, dimmed by the cloud that covers it. Its disc is drawn no brighter than MAX_DISC,
so that glare, which counts the light, does not count it twice.
Source: Nishita et al. 1993, "Display of the Earth taking into account atmospheric scattering"; for
the phase of haze Cornette & Shanks 1992. Departures: no ozone; turbidity scales the haze, as
the optical thickness of all air over that of its molecules. Clouds are a plane of fractal noise
2 km above, lit by the same sun through themselves; no source but looks.
"""

from __future__ import annotations

import math
from functools import partial
from typing import cast

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import arctan2, cos, dot, einsum, exp, hypot, power, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server import __version__
from catoptra_server.world.panorama import (
    Panorama,
    find_panorama,
    interpolate,
    make_panorama,
    solid_angles,
    texel_directions,
)
from catoptra_server.world.world_description import DirectionalLight, HemisphereLight, Light, Rgb

# 0.27 degrees a texel; of 1024 the upper half leaves the cache of a processor, +1.5 ms at 640 px.
_SIZE = 768
# Increased when skies change.
_FORMAT_VERSION = 3
MAX_DISC = 20.0
"""Largest radiance of the sun's disc: a seven hundredth of its light at most, the rest is the
directional light's."""
_SUN_RADIUS_RAD, _SUN_EDGE_RAD = math.radians(0.267), math.radians(0.15)

# Metres; the atmosphere ends where a millionth of it is above.
_EARTH, _TOP, _EYE = 6.371e6, 1.0e5, 2.0
# Scattering of molecules per metre at sea level, for 680, 550 and 440 nm; scale heights
# of the air and of haze.
_RAYLEIGH = np.array((5.8e-6, 13.5e-6, 33.1e-6))
_HEIGHTS = np.array((8.0e3, 1.2e3))
# Forward scattering of haze, and its extinction over its scattering.
_MIE_ASYMMETRY, _MIE_EXTINCTION = 0.76, 1.1
_GROUND = np.array((0.20, 0.19, 0.16))
# Irradiance of the sun above the air, in the scale above.
_SUN = 1.44
# Steps of a view and of its ways to the sun; directions of the table, denser at the horizon.
_VIEW_STEPS, _SUN_STEPS, _ELEVATIONS, _AZIMUTHS = 32, 12, 128, 25


@dataclass(frozen=True, slots=True)
class SkyDescription:
    """Sky of a world file."""

    elevation_rad: float
    """Of the sun above the horizon."""
    azimuth_rad: float
    """Of the sun, as a yaw: clockwise from x, from above."""
    turbidity: float = 2.0
    """Optical thickness of the air with its haze over that without; at least 1."""
    clouds: float = 0.0
    """Part of the sky that clouds cover, from 0 to 1."""
    seed: int = 0
    """Number of the clouds' pattern."""

    @property
    def towards_sun(self) -> Floats:
        """(3,) unit direction, world frame."""
        level = cos(self.elevation_rad)
        x, y = level * cos(self.azimuth_rad), level * sin(self.azimuth_rad)
        return np.array((x, y, -sin(self.elevation_rad)))


def find_sky(sky: SkyDescription) -> tuple[Panorama, tuple[Light, ...]]:
    """Panorama of a sky, its sun and its hemisphere light, from the cache or computed now."""
    numbers = (sky.elevation_rad, sky.azimuth_rad, sky.turbidity, sky.clouds, sky.seed)
    # With the release: another one may compute another sky.
    key = "-".join((str(_FORMAT_VERSION), __version__, *(f"{number:.12g}" for number in numbers)))
    panorama, irradiance = find_panorama(key, 3, lambda: compute_sky(sky, _SIZE))
    sun, up, down = (cast("Rgb", tuple(row)) for row in irradiance.tolist())
    x, y, z = (-sky.towards_sun).tolist()
    return panorama, (DirectionalLight((x, y, z), sun), HemisphereLight(up, down))


def compute_sky(sky: SkyDescription, size: int) -> tuple[Panorama, Floats]:
    """Panorama of a sky of a size, and (3, 3) irradiance: the sun's, from above, from below."""
    directions = texel_directions(size).reshape(-1, 3)
    directions /= np.sqrt(einsum("ni,ni->n", directions, directions))[:, None]
    weights = solid_angles(size).reshape(-1, 1)
    height = -directions[:, 2:]
    upper, level = height[:, 0] > 0.0, sin(sky.elevation_rad)
    sun = compute_sunlight(sky)
    once, again, passing = _scatter(sky, directions)
    # A mean of which each direction adds a part to itself.
    mean, added = ((weights * light).sum(axis=0) / (4.0 * math.pi) for light in (once, again))
    radiance = once + again * ((mean + 0.5 * _GROUND * sun * level) / (1.0 - added))
    if sky.clouds > 0.0:
        light = sun, radiance[upper].mean(axis=0)
        opacity, lit = _draw_clouds(sky, directions[upper], light)
        radiance[upper] += opacity * (lit - radiance[upper])
        covering, _ = _draw_clouds(sky, sky.towards_sun[None], light)
        sun = sun * (1.0 - covering[0])
    of_sky = (weights * np.maximum(height, 0.0) * radiance).sum(axis=0) / math.pi
    radiance[~upper] += passing[~upper] * (_GROUND * (sun * level + of_sky))
    of_ground = (weights * np.maximum(-height, 0.0) * radiance).sum(axis=0) / math.pi
    cross = np.cross(directions, sky.towards_sun)
    angles = arctan2(np.sqrt(einsum("ni,ni->n", cross, cross)), dot(directions, sky.towards_sun))
    disc = (
        np.clip((_SUN_RADIUS_RAD - angles) / _SUN_EDGE_RAD + 0.5, 0.0, 1.0)[:, None]
        * upper[:, None]
    )
    # In radiance of which a white surface has 1 per irradiance of 1; of one colour whatever its
    # brightness: the brightest channel is at the limit.
    radiance += disc * sun * min(_SUN_RADIUS_RAD**-2, MAX_DISC / max(float(sun.max()), 1e-9))
    panorama = make_panorama(radiance.reshape(size, size, 3))
    return panorama, np.stack((sun, of_sky, of_ground))


def compute_sunlight(sky: SkyDescription) -> Floats:
    """(3,) irradiance by a sky's sun of what faces it, without clouds; 0 below the horizon."""
    height, up = np.array([_EARTH + _EYE]), np.array([sin(sky.elevation_rad)])
    _, to_sun, is_hidden = _march(height, up, _SUN_STEPS)
    return np.asarray(_SUN * _find_passing(sky, to_sun.sum(axis=-2))[0] * ~is_hidden)


def _find_scattering(sky: SkyDescription) -> Floats:
    """(2, 3) scattering per metre of sea-level air and haze."""
    haze = (sky.turbidity - 1.0) * _RAYLEIGH[1] * _HEIGHTS[0] / _HEIGHTS[1]
    return np.stack((_RAYLEIGH, np.full(3, haze)))


def _find_passing(sky: SkyDescription, depths: Floats) -> Floats:
    """(..., 3) parts of light that pass (..., 2) depths of air and haze, metres at sea level."""
    air, haze = _find_scattering(sky)
    return exp(-depths[..., :1] * air - depths[..., 1:] * (_MIE_EXTINCTION * haze))


def _scatter(sky: SkyDescription, directions: Floats) -> tuple[Floats, Floats, Floats]:
    """Air in (n, 3) unit directions, (n, 3) each: radiance of light scattered once, parts of a mean
    radiance that are scattered again, and parts of light that pass."""
    table = _integrate(sky)
    elevation = arctan2(-directions[:, 2], hypot(directions[:, 0], directions[:, 1]))
    relative = elevation / (0.5 * math.pi)
    rows = 0.5 + 0.5 * np.copysign(np.sqrt(np.abs(relative)), relative)
    turned = arctan2(directions[:, 1], directions[:, 0]) - sky.azimuth_rad
    columns = np.abs(np.mod(turned + math.pi, 2.0 * math.pi) - math.pi) / math.pi
    places = np.stack((rows * (_ELEVATIONS - 1), columns * (_AZIMUTHS - 1)))
    # In parts that the processor's cache holds.
    values = [
        interpolate(
            lambda y, x: table[np.minimum(y, _ELEVATIONS - 1), np.minimum(x, _AZIMUTHS - 1)], *part
        )
        for part in np.array_split(places, -(-len(directions) // 2**12), axis=1)
    ]
    molecules, small, again, passing = np.moveaxis(np.concatenate(values).reshape(-1, 4, 3), 1, 0)
    cosine = dot(directions, sky.towards_sun)[:, None]
    squared, g = 1.0 + cosine * cosine, _MIE_ASYMMETRY
    # Times pi: radiance is that of a white surface of irradiance 1, as everywhere here.
    forward = (1.0 - g * g) / (2.0 + g * g) / power(1.0 + g * g - 2.0 * g * cosine, 1.5)
    once = squared * (3.0 / 16.0 * molecules + 3.0 / 8.0 * forward * small)
    return once, again, passing


def _integrate(sky: SkyDescription) -> Floats:
    """(e, a, 12) by elevation and azimuth from the sun: light scattered by molecules and by haze
    but for their phases, parts of a mean that are scattered, parts that pass."""
    scattering = _find_scattering(sky)
    # Squares put half of the directions within a quarter of the way from the horizon.
    steps = np.linspace(-1.0, 1.0, _ELEVATIONS)
    elevations = 0.5 * math.pi * steps * np.abs(steps)
    forward, up = cos(elevations), sin(elevations)
    eye = np.full(_ELEVATIONS, _EARTH + _EYE)
    distance, parts, _ = _march(eye, up, _VIEW_STEPS)
    # Up to the middle of a step, to third order.
    before = np.cumsum(parts, axis=1) - 0.5 * parts - np.gradient(parts, axis=1) / 12.0
    x, y = forward[:, None] * distance, _EARTH + _EYE + up[:, None] * distance
    radius, level = hypot(x, y), cos(sky.elevation_rad)
    table = np.zeros((_ELEVATIONS, _AZIMUTHS, 4, 3))
    for number, azimuth in enumerate(np.linspace(0.0, math.pi, _AZIMUTHS).tolist()):
        # The sun's direction leaves the plane of the view; its length does not.
        cosine = (x * level * cos(azimuth) + y * sin(sky.elevation_rad)) / radius
        _, to_sun, is_hidden = _march(radius, cosine, _SUN_STEPS)
        light = _find_passing(sky, before + to_sun.sum(axis=-2)) * ~is_hidden[..., None]
        table[:, number, :2] = _SUN * scattering * einsum("esk,esc->ekc", parts, light)
    again = scattering * einsum("esk,esc->ekc", parts, _find_passing(sky, before))
    table[:, :, 2] = again.sum(axis=1)[:, None]
    table[:, :, 3] = _find_passing(sky, parts.sum(axis=1))[:, None]
    return table.reshape(_ELEVATIONS, _AZIMUTHS, 12)


def _march(
    radius: Floats, cosine: Floats, steps: int
) -> tuple[Floats, Floats, npt.NDArray[np.bool_]]:
    """Ways from (...) distances from the Earth's centre, at cosines from the vertical, to the
    ground or the end of the air: (..., s) distances of steps, (..., s, 2) depths of molecules and
    of haze in them, metres, and whether the ground ends them."""
    middle = -radius * cosine
    squared = middle * middle - radius * radius
    is_hidden = (middle > 0.0) & (squared + _EARTH * _EARTH >= 0.0)
    to_ground = middle - np.sqrt(np.maximum(squared + _EARTH * _EARTH, 0.0))
    to_top = middle + np.sqrt(np.maximum(squared + (_EARTH + _TOP) ** 2, 0.0))
    # The midpoint rule in the cube root of the distance: most haze is near, and without slope and
    # third derivative at the eye the rule is of sixth order. 12 steps leave 1e-4 of sunlight.
    roots = (np.arange(steps) + 0.5) / steps
    far = np.where(is_hidden, to_ground, to_top)[..., None]
    distance = roots**3 * far
    squares = np.square(radius)[..., None] + distance * (distance - 2.0 * middle[..., None])
    height = np.maximum(np.sqrt(squares) - _EARTH, 0.0)[..., None]
    lengths = (3.0 / steps * np.square(roots) * far)[..., None]
    return distance, exp(-height / _HEIGHTS) * lengths, is_hidden


# Metres above the eye, and the size of the largest clouds; octaves of noise.
_CLOUD_HEIGHT, _CLOUD_SIZE, _OCTAVES = 2.0e3, 2.6e3, 6
# Optical thickness where the noise is one above the threshold, and metres to what shades a cloud.
_CLOUD_DEPTH, _SHADE_M = 9.0, 350.0
_CLOUD_HAZE_M = 2.5e4


def _draw_clouds(
    sky: SkyDescription, directions: Floats, light: tuple[Floats, Floats]
) -> tuple[Floats, Floats]:
    """(n, 1) opacities and (n, 3) radiance of the clouds in (n, 3) directions above the horizon,
    by the light of sun and sky on them."""
    up = np.maximum(-directions[:, 2], 1e-3)
    # The layer follows the Earth's curvature: 160 km away at the horizon.
    reach = _EARTH * up
    distance = np.sqrt(reach * reach + 2.0 * _EARTH * _CLOUD_HEIGHT) - reach
    points = directions[:, :2] * distance[:, None]
    depth = _cloud_depth(sky, points)
    sun = sky.towards_sun
    shading = _cloud_depth(sky, points + _SHADE_M * sun[:2])
    opacity = (1.0 - exp(-depth)) * exp(-distance / _CLOUD_HAZE_M)
    of_sun, of_sky = light
    forward = 1.0 + 0.6 * power(np.maximum(dot(directions, sun), 0.0), 8.0)
    passing = (0.35 + 0.65 * exp(-0.35 * shading)) * (0.5 + 0.5 * exp(-0.2 * depth)) * forward
    return opacity[:, None], np.asarray(passing[:, None] * of_sun + of_sky)


def _cloud_depth(sky: SkyDescription, points: Floats) -> Floats:
    """(n,) optical thickness of the clouds at (n, 2) points of their layer, metres."""
    noise = np.zeros(len(points))
    for octave in range(_OCTAVES):
        places = points * (2.03**octave / _CLOUD_SIZE)
        part = places - np.floor(places)
        columns, rows = (places - part + part * part * (3.0 - 2.0 * part)).T
        values = interpolate(partial(_hash, sky.seed + 101 * octave), rows, columns)
        noise += 0.5 ** (octave + 1) * values[:, 0]
    # The noise is nearly normal about 0.49 with a deviation of 0.12.
    threshold = 0.49 + 0.12 * 2.2 * (1.0 - 2.0 * sky.clouds)
    return np.asarray(_CLOUD_DEPTH * np.maximum(noise - threshold, 0.0) / 0.25)


def _hash(seed: int, row: npt.NDArray[np.intp], column: npt.NDArray[np.intp]) -> Floats:
    """(n, 1) numbers from 0 to 1 of lattice points."""
    bits = (column * 374761393 + row * 668265263 + seed * 2147483647).astype(np.uint32)
    bits = (bits ^ bits >> np.uint32(13)) * np.uint32(1274126177)
    return np.asarray((bits ^ bits >> np.uint32(16)) / 2.0**32)[:, None]
