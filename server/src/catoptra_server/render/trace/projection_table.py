"""The camera model for many points at once: a table over the direction's height, in float32.

Accurate to a tenth of a pixel, enough to decide where rays are needed; pixels that are shown come
from rays of the exact model in optics/omni_camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.trace.packed_light import Float32s

# Largest error of a pixel position on the mirror: half for the table's steps, which are refined
# until they fit, half for the float32 directions and products.
MAX_PIXEL_ERROR_PX = 0.1
_MIN_STEPS = 4096
# Towards the antipode the radius grows too fast with the height for any table.
_MAX_STEPS = 2**20
# Edges that end beyond the rim are followed a little beyond the rim.
_BEYOND_RIM_RAD = 0.1
# Scale beyond the table: directions there land far outside the image.
_OUTSIDE_PX = 1e9


@dataclass(frozen=True, slots=True, eq=False)
class ProjectionTable:
    """The camera model in tables."""

    centre_px: tuple[float, float]
    """Image centre (u, v)."""
    axes: Float32s
    """(2, 2) rotation: pixel = centre + scale(z) * (axes @ (x, y)) of a unit vector (x, y, z)."""
    radial_scale: Float32s
    """(steps + 1,) pixels per unit of (x, y) at heights z from `min_height` to 1."""
    min_height: float
    """Height z of the first entry, a little beyond the rim."""
    max_magnification: Floats
    """(m + 1,) greatest pixels per radian up to incidence angles from 0 to beyond the rim."""
    rim_rad: float
    """Incidence angle of the rim."""

    @classmethod
    def from_camera(cls, camera: OmniCamera) -> ProjectionTable | None:
        """Tables of a camera, None if the rim is too close to the antipode for any table."""
        # Half-way to the antipode at most: camera models end before it.
        max_angle = camera.rim_rad + min(_BEYOND_RIM_RAD, 0.5 * (math.pi - camera.rim_rad))
        min_height = math.cos(max_angle)
        scale = _make_radial_scale(camera, min_height)
        if scale is None:
            return None
        theta = np.linspace(0.0, max_angle, _MIN_STEPS + 1)
        radius = _radius_px(camera, theta)
        # Two magnifications per angle: radial from the radii's differences, tangential r /
        # sin(theta).
        tangential = radius[1:] / np.sin(theta[1:])
        magnification = np.maximum(np.diff(radius) / np.diff(theta), tangential)
        ca, sa = math.cos(camera.image_up_azimuth_rad), math.sin(camera.image_up_azimuth_rad)
        return cls(
            centre_px=camera.centre_px,
            axes=np.array(((sa, -ca), (-ca, -sa)), dtype=np.float32),
            radial_scale=scale,
            min_height=min_height,
            # Non-decreasing, so an entry bounds all smaller angles too, and covers the interval
            # before it.
            max_magnification=np.maximum.accumulate(np.append(magnification[0], magnification)),
            rim_rad=camera.rim_rad,
        )

    @property
    def memory_bytes(self) -> int:
        """Size of the tables."""
        return self.radial_scale.nbytes + self.max_magnification.nbytes

    def pixel_from_direction(
        self, x: Float32s, y: Float32s, z: Float32s
    ) -> tuple[Float32s, Float32s]:
        """(n,) columns and rows of unit directions; far outside the image beyond the domain."""
        step = np.float32((len(self.radial_scale) - 1) / (1.0 - self.min_height))
        # Nearest entry instead of interpolation: one take() per call; the table is refined instead.
        index = ((z - np.float32(self.min_height)) * step + np.float32(0.5)).astype(np.int32)
        scale = self.radial_scale.take(index, mode="clip")
        (ux, uy), (vx, vy) = self.axes
        u = scale * (ux * x + uy * y) + np.float32(self.centre_px[0])
        v = scale * (vx * x + vy * y) + np.float32(self.centre_px[1])
        return u, v

    def max_pixels_per_radian(self, incidence_rad: Floats) -> Floats:
        """Greatest magnification up to an incidence angle, in any direction."""
        max_angle = math.acos(self.min_height)
        steps = len(self.max_magnification) - 1
        index = np.ceil(incidence_rad * (steps / max_angle)).astype(np.int64)
        return self.max_magnification.take(index, mode="clip")


def _make_radial_scale(camera: OmniCamera, min_height: float) -> Float32s | None:
    """Pixels per unit of direction at heights from `min_height` to 1, None if too coarse."""
    steps = _MIN_STEPS
    while steps <= _MAX_STEPS:
        angle = np.arccos(np.linspace(min_height, 1.0, steps + 1)[:-1])
        scale = _radius_px(camera, angle) / np.sin(angle)
        on_mirror = angle <= camera.rim_rad
        # A height is at most half a step away from its entry.
        error_px = 0.5 * np.abs(np.diff(scale[on_mirror])) * np.sin(angle[on_mirror][1:])
        if error_px.max(initial=0.0) < 0.5 * MAX_PIXEL_ERROR_PX:
            scale[0] = _OUTSIDE_PX
            return np.append(scale, scale[-1]).astype(np.float32)
        steps *= 2
    return None


def _radius_px(camera: OmniCamera, theta: Floats) -> Floats:
    """Image radii of incidence angles; constant from half-way between rim and asymptote.

    Directions beyond the rim are not shown, only followed, and must not jump.
    """
    asymptote_rad = 2.0 * math.atan(camera.mirror.t_limit)
    end = camera.rim_rad + min(_BEYOND_RIM_RAD, 0.5 * (asymptote_rad - camera.rim_rad))
    t = np.tan(0.5 * np.minimum(theta, end))
    return camera.horizon_radius_px * camera.mirror.radius_ratio_from_t(t)
