"""A clear or clouded sky with its sun, from one integral of light scattered by the air.

Sunlight is scattered by molecules (Rayleigh) and haze (Mie); what the ground reflects is seen
through the same air. What is scattered more than once counts as light from all directions alike,
the mean of sky and ground: it makes horizons bright. Sun, sky and ground have one scale: 1 is a
white level surface under a sun of 45 degrees and a turbidity of 2. The sun itself is a directional
light, dimmed by the cloud that covers it. Its disc is drawn no brighter than MAX_DISC, so that
glare, which counts the light, does not count it twice.
Source: Nishita et al. 1993, "Display of the Earth taking into account atmospheric scattering"; for
the phase of haze Cornette & Shanks 1992. Departures: no ozone; turbidity scales the haze, as
the optical thickness of all air over that of its molecules. Clouds are a plane of fractal noise
2 km above, lit by the same sun through themselves; no source but looks.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import arctan2, cos, dot, einsum, exp, hypot, power, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server import __version__
from catoptra_server.runtime.array_cache import ArrayCache, find_cache_folder
from catoptra_server.world.panorama import (
    Panorama,
    make_panorama,
    restore_panorama,
    solid_angles,
    texel_directions,
)
from catoptra_server.world.world_description import DirectionalLight, HemisphereLight, Light, Rgb

# 0.27 degrees a texel; of 1024 the upper half leaves the cache of a processor, +1.5 ms at 640 px.
_SIZE = 768
# Increased when skies change.
_FORMAT_VERSION = 1
MAX_DISC = 20.0
"""Largest radiance of the sun's disc: a seven hundredth of its light at most, the rest is the
directional light's."""
_SUN_RADIUS_RAD, _SUN_EDGE_RAD = math.radians(0.267), math.radians(0.15)

# Metres; the atmosphere ends where a millionth of it is above.
_EARTH, _TOP, _EYE = 6.371e6, 1.0e5, 2.0
# Scattering of molecules per metre at sea level, for 680, 550 and 440 nm, and scale heights.
_RAYLEIGH = np.array((5.8e-6, 13.5e-6, 33.1e-6))
_RAYLEIGH_HEIGHT, _MIE_HEIGHT = 8.0e3, 1.2e3
# Forward scattering of haze, and its extinction over its scattering.
_MIE_ASYMMETRY, _MIE_EXTINCTION = 0.76, 1.1
_GROUND = np.array((0.20, 0.19, 0.16))
# Irradiance of the sun above the air, in the scale above.
_SUN = 1.42
# Steps of a view and of its ways to the sun; directions of the tables, denser at the horizon.
_VIEW_STEPS, _SUN_STEPS, _ELEVATIONS, _AZIMUTHS = 32, 12, 64, 25


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
    cache = ArrayCache(find_cache_folder("skies"))
    numbers = (sky.elevation_rad, sky.azimuth_rad, sky.turbidity, sky.clouds, sky.seed)
    # With the release: another one may compute another sky.
    parts = (str(_FORMAT_VERSION), __version__, *(f"{number:.12g}" for number in numbers))
    found = restore_panorama(cache, "-".join(parts), 3)
    if found is not None and found[1][0].shape == (3, 3):
        panorama, (irradiance,) = found
    else:
        panorama, irradiance = compute_sky(sky, _SIZE)
        cache.write("-".join(parts), (panorama.texels, panorama.bounds, irradiance))
    sun, up, down = (cast("Rgb", tuple(row)) for row in irradiance.tolist())
    x, y, z = (-sky.towards_sun).tolist()
    return panorama, (DirectionalLight((x, y, z), sun), HemisphereLight(up, down))


def compute_sky(sky: SkyDescription, size: int) -> tuple[Panorama, Floats]:
    """Panorama of a sky of a size, and (3, 3) irradiance: the sun's, from above, from below."""
    directions = texel_directions(size).reshape(-1, 3)
    directions /= np.sqrt(einsum("ni,ni->n", directions, directions))[:, None]
    air = _Air(sky)
    radiance, again = air.scatter(directions)
    sun = air.find_sunlight()
    weights = solid_angles(size).reshape(-1, 1)
    height = -directions[:, 2:]
    upper = height[:, 0] > 0.0
    reflected = 0.5 * _GROUND * sun * sin(sky.elevation_rad)
    # A mean of which each direction adds a part to itself.
    mean, added = ((weights * light).sum(axis=0) / (4.0 * math.pi) for light in (radiance, again))
    radiance += again * ((mean + reflected) / (1.0 - added))
    if sky.clouds > 0.0:
        light = sun, radiance[upper].mean(axis=0)
        opacity, lit = _draw_clouds(sky, directions[upper], light)
        radiance[upper] += opacity * (lit - radiance[upper])
        covering, _ = _draw_clouds(sky, sky.towards_sun[None], light)
        sun = sun * (1.0 - covering[0])
    of_sky = (weights * np.maximum(height, 0.0) * radiance).sum(axis=0) / math.pi
    ground = _GROUND * (sun * sin(sky.elevation_rad) + of_sky)
    radiance[~upper] += air.find_passing(directions[~upper]) * ground
    of_ground = (weights * np.maximum(-height, 0.0) * radiance).sum(axis=0) / math.pi
    disc = np.clip(
        (_SUN_RADIUS_RAD + 0.5 * _SUN_EDGE_RAD - air.find_sun_angles(directions)) / _SUN_EDGE_RAD,
        0.0,
        1.0,
    )[:, None]
    # Of one colour whatever its brightness: the brightest channel is at the limit.
    shown = sun * min(1.0 / _SUN_SOLID_ANGLE, MAX_DISC / max(float(sun.max()), 1e-9))
    radiance[upper] += disc[upper] * shown
    panorama = make_panorama(radiance.reshape(size, size, 3))
    return panorama, np.stack((sun, of_sky, of_ground))


# In radiance of which a white surface has 1 per irradiance of 1.
_SUN_SOLID_ANGLE = _SUN_RADIUS_RAD * _SUN_RADIUS_RAD


class _Air:
    """Scattered light and the light that passes, for one sun."""

    def __init__(self, sky: SkyDescription) -> None:
        self._sun = sky.towards_sun
        self._elevation = sky.elevation_rad
        haze = (sky.turbidity - 1.0) * _RAYLEIGH[1] * _RAYLEIGH_HEIGHT / _MIE_HEIGHT
        self._mie = float(haze)
        # Squares put half of the directions within a quarter of the way from the horizon.
        steps = np.linspace(-1.0, 1.0, 2 * _ELEVATIONS)
        self._elevations = 0.5 * math.pi * steps * np.abs(steps)
        self._azimuths = np.linspace(0.0, math.pi, _AZIMUTHS)
        self._table, self._again, self._passing = self._integrate()

    def _extinction(self, depths: Floats) -> Floats:
        """(..., 3) parts of light that pass (..., 2) depths of molecules and of haze, metres."""
        optical = depths[..., :1] * _RAYLEIGH + _MIE_EXTINCTION * self._mie * depths[..., 1:]
        return np.asarray(exp(-optical))

    def find_sunlight(self) -> Floats:
        """(3,) irradiance of the sun at normal incidence."""
        depths, _ = _depths_to_sun(np.array((0.0, _EYE)), self._towards(0.0))
        return np.asarray(_SUN * self._extinction(depths))

    def _towards(self, azimuth: float | Floats) -> tuple[Floats, Floats]:
        """Direction to the sun in the plane of a view at an azimuth from the sun: forward, up."""
        return cos(self._elevation) * cos(np.asarray(azimuth)), np.asarray(sin(self._elevation))

    def _integrate(self) -> tuple[Floats, Floats, Floats]:
        """(e, a, 2, 3) light scattered by molecules and haze but for their phases, by elevation
        and azimuth from the sun; (e, 3) parts of light from all directions that are scattered
        towards the eye; (e, 3) parts of light that pass all the way."""
        forward, up = cos(self._elevations), sin(self._elevations)
        length = _length_to(forward, up, _EARTH + _TOP)
        ground = _length_to(forward, up, _EARTH)
        length = np.where((up < 0.0) & (ground > 0.0), ground, length)
        # Steps that grow with the distance: most haze is near.
        bounds = np.square(np.linspace(0.0, 1.0, _VIEW_STEPS + 1)) * length[:, None]
        middle, step = 0.5 * (bounds[:, 1:] + bounds[:, :-1]), np.diff(bounds, axis=1)
        place = np.stack((forward[:, None] * middle, _EYE + up[:, None] * middle), axis=-1)
        density = _densities(_height_of(place))
        parts = density * step[..., None]
        before = np.cumsum(parts, axis=1) - 0.5 * parts
        total = np.zeros((len(forward), _AZIMUTHS, 2, 3))
        for number, azimuth in enumerate(self._azimuths.tolist()):
            to_sun, is_lit = _depths_to_sun(place, self._towards(azimuth))
            light = self._extinction(before + to_sun) * is_lit[..., None]
            total[:, number] = einsum("esk,esc->ekc", parts, light)
        scattering = np.stack((_RAYLEIGH, np.full(3, self._mie)))
        again = einsum("esk,esc->ekc", parts, self._extinction(before))
        again = (scattering * again).sum(axis=1)
        return _SUN * scattering * total, again, self._extinction(parts.sum(axis=1))

    def find_sun_angles(self, directions: Floats) -> Floats:
        """(n,) angles of (n, 3) unit directions from the sun, radians."""
        cross = np.cross(directions, self._sun)
        across = np.sqrt(einsum("ni,ni->n", cross, cross))
        return np.asarray(arctan2(across, dot(directions, self._sun)))

    def _rows(self, directions: Floats) -> Floats:
        """(n,) places of (n, 3) unit directions among the elevations."""
        elevation = arctan2(-directions[:, 2], hypot(directions[:, 0], directions[:, 1]))
        relative = elevation / (0.5 * math.pi)
        steps = np.copysign(np.sqrt(np.abs(relative)), relative)
        return np.clip(0.5 * (steps + 1.0), 0.0, 1.0) * (len(self._elevations) - 1)

    def scatter(self, directions: Floats) -> tuple[Floats, Floats]:
        """(n, 3) radiance in (n, 3) unit directions by light scattered once, and parts of a mean
        radiance that are scattered again."""
        azimuth = arctan2(directions[:, 1], directions[:, 0])
        turned = azimuth - arctan2(self._sun[1], self._sun[0])
        column = np.abs(np.mod(turned + math.pi, 2.0 * math.pi) - math.pi)
        column = np.clip(column / math.pi, 0.0, 1.0) * (_AZIMUTHS - 1)
        table = self._table.reshape(*self._table.shape[:2], 6)
        rows = self._rows(directions)
        values = _interpolate(table, rows, column).reshape(-1, 2, 3)
        cosine = dot(directions, self._sun)
        squared, g = 1.0 + cosine * cosine, _MIE_ASYMMETRY
        # Times pi: radiance is that of a white surface of irradiance 1, as everywhere here.
        molecules = 3.0 / 16.0 * squared
        haze = 3.0 / 8.0 * (1.0 - g * g) / (2.0 + g * g) * squared
        haze = haze / power(1.0 + g * g - 2.0 * g * cosine, 1.5)
        once = molecules[:, None] * values[:, 0] + haze[:, None] * values[:, 1]
        return once, _interpolate(self._again[:, None], rows, np.zeros(len(rows)))

    def find_passing(self, directions: Floats) -> Floats:
        """(n, 3) parts of the ground's light that pass the air towards the eye."""
        rows = self._rows(directions)
        return _interpolate(self._passing[:, None], rows, np.zeros(len(rows)))


def _interpolate(table: Floats, rows: Floats, columns: Floats) -> Floats:
    """(n, k) values of a (h, w, k) table, bilinear."""
    top = np.minimum(rows.astype(np.intp), table.shape[0] - 2)
    left = np.minimum(columns.astype(np.intp), max(table.shape[1] - 2, 0))
    right = np.minimum(left + 1, table.shape[1] - 1)
    fy, fx = (rows - top)[:, None], (columns - left)[:, None]
    upper = table[top, left] + fx * (table[top, right] - table[top, left])
    lower = table[top + 1, left] + fx * (table[top + 1, right] - table[top + 1, left])
    return np.asarray(upper + fy * (lower - upper))


def _height_of(place: Floats) -> Floats:
    """(...) heights above the ground of (..., 2) places: forward, and up from below the eye."""
    return np.asarray(hypot(place[..., 0], place[..., 1] + _EARTH) - _EARTH)


def _densities(height: Floats) -> Floats:
    """(..., 2) densities of molecules and haze over those at sea level."""
    above = np.maximum(height, 0.0)
    return np.stack((exp(-above / _RAYLEIGH_HEIGHT), exp(-above / _MIE_HEIGHT)), axis=-1)


def _length_to(forward: Floats, up: Floats, radius: float) -> Floats:
    """(n,) metres from the eye to a sphere about the Earth's centre; below 0 where it is missed."""
    middle = -(_EARTH + _EYE) * up
    squared = middle * middle - (_EARTH + _EYE) ** 2 + radius * radius
    root = np.sqrt(np.maximum(squared, 0.0))
    nearest = middle - root if radius <= _EARTH else middle + root
    return np.where(squared < 0.0, -1.0, nearest)


def _depths_to_sun(
    place: Floats, towards: tuple[Floats, Floats]
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """(..., 2) depths of molecules and haze from (..., 2) places to the sun, metres; whether the
    Earth does not hide it."""
    forward, up = towards
    x, y = place[..., 0], place[..., 1] + _EARTH
    middle = -(x * forward + y * up)
    # The sun's direction leaves the plane of the view; its length does not.
    squared = middle * middle - x * x - y * y
    far = middle + np.sqrt(np.maximum(squared + (_EARTH + _TOP) ** 2, 0.0))
    is_lit = (middle < 0.0) | (squared + _EARTH * _EARTH < 0.0)
    bounds = np.square(np.linspace(0.0, 1.0, _SUN_STEPS + 1))
    distance = 0.5 * (bounds[1:] + bounds[:-1]) * far[..., None]
    step = np.diff(bounds) * far[..., None]
    radius = np.sqrt((x * x + y * y)[..., None] + distance * (distance - 2.0 * middle[..., None]))
    density = _densities(radius - _EARTH)
    return np.asarray((density * step[..., None]).sum(axis=-2)), is_lit


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
        lattice = _lattice_noise(points * (2.03**octave / _CLOUD_SIZE), sky.seed + 101 * octave)
        noise += 0.5 ** (octave + 1) * lattice
    # The noise is nearly normal about 0.49 with a deviation of 0.12.
    threshold = 0.49 + 0.12 * 2.2 * (1.0 - 2.0 * sky.clouds)
    return np.asarray(_CLOUD_DEPTH * np.maximum(noise - threshold, 0.0) / 0.25)


def _lattice_noise(points: Floats, seed: int) -> Floats:
    """(n,) smooth noise from 0 to 1 at (n, 2) points: hashed values at integers, interpolated."""
    first = np.floor(points)
    part = points - first
    weight = part * part * (3.0 - 2.0 * part)
    column, row = first.astype(np.int64).T
    corners = [[_hash(column + i, row + k, seed) for i in range(2)] for k in range(2)]
    (a, b), (c, d) = corners
    upper, lower = a + weight[:, 0] * (b - a), c + weight[:, 0] * (d - c)
    return np.asarray(upper + weight[:, 1] * (lower - upper))


def _hash(column: npt.NDArray[np.int64], row: npt.NDArray[np.int64], seed: int) -> Floats:
    """(n,) numbers from 0 to 1 of lattice points."""
    bits = (column * 374761393 + row * 668265263 + seed * 2147483647).astype(np.uint32)
    bits = (bits ^ bits >> np.uint32(13)) * np.uint32(1274126177)
    return np.asarray((bits ^ bits >> np.uint32(16)) / 2.0**32)
