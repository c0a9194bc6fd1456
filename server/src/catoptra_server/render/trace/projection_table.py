"""The camera law for many points at once: a table over the direction's height, in float32.

Good to a tenth of a pixel, for deciding where rays are needed; what is shown comes from rays of the
law itself, optics/omni_camera.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.trace.packed_light import Float32s

# What a pixel read from the table may be off on the mirror: half of it by the table's steps, which
# are made fine enough, the rest by the float32 of everything before.
MAX_PIXEL_ERROR_PX = 0.1
_MIN_STEPS = 4096
# Towards the antipode the picture turns so fast with the height that no table follows.
_MAX_STEPS = 2**20
# Lines that end beyond the rim are followed a little beyond it.
_BEYOND_RIM_RAD = 0.1
# Beyond the table the picture is far away.
_OUTSIDE_PX = 1e9


@dataclass(frozen=True, slots=True, eq=False)
class ProjectionTable:
    """The camera law in tables.

    axes (2, 2): pixel = centre + scale(z) * (axes @ (x, y)) of a unit direction (x, y, z).
    scale: (steps + 1,) pixels at heights from `lowest` to 1. magnification: (m + 1,) greatest
    pixels a radian up to incidence angles from 0 to `rim_rad` and a little beyond.
    """

    centre_px: tuple[float, float]
    axes: Float32s
    radial_scale: Float32s
    min_height: float
    max_magnification: Floats
    rim_rad: float

    @classmethod
    def from_camera(cls, camera: OmniCamera) -> ProjectionTable | None:
        """Return the tables of a camera; None if its rim is too near to the antipode for any."""
        # Before the antipode, where the mirrors' laws have ended.
        last = camera.rim_rad + min(_BEYOND_RIM_RAD, 0.5 * (math.pi - camera.rim_rad))
        lowest = math.cos(last)
        scale = _make_radial_scale(camera, lowest)
        if scale is None:
            return None
        theta = np.linspace(0.0, last, _MIN_STEPS + 1)
        radius = _radius_px(camera, theta)
        sagittal = radius[1:] / np.sin(theta[1:])
        steepest = np.maximum(np.diff(radius) / np.diff(theta), sagittal)
        ca, sa = math.cos(camera.image_up_azimuth_rad), math.sin(camera.image_up_azimuth_rad)
        return cls(
            centre_px=camera.centre_px,
            axes=np.array(((sa, -ca), (-ca, -sa)), dtype=np.float32),
            radial_scale=scale,
            min_height=lowest,
            max_magnification=np.maximum.accumulate(np.append(steepest[0], steepest)),
            rim_rad=camera.rim_rad,
        )

    def pixel_from_direction(
        self, x: Float32s, y: Float32s, z: Float32s
    ) -> tuple[Float32s, Float32s]:
        """Return (n,) columns and rows of unit directions; far away where the law has ended."""
        step = np.float32((len(self.radial_scale) - 1) / (1.0 - self.min_height))
        index = ((z - np.float32(self.min_height)) * step + np.float32(0.5)).astype(np.int32)
        scale = self.radial_scale.take(index, mode="clip")
        (ux, uy), (vx, vy) = self.axes
        u = scale * (ux * x + uy * y) + np.float32(self.centre_px[0])
        v = scale * (vx * x + vy * y) + np.float32(self.centre_px[1])
        return u, v

    def max_pixels_per_radian(self, incidence_rad: Floats) -> Floats:
        """Return the greatest magnification up to an angle, in any direction; beyond all, all."""
        last = math.acos(self.min_height)
        steps = len(self.max_magnification) - 1
        index = np.ceil(incidence_rad * (steps / last)).astype(np.int64)
        return self.max_magnification.take(index, mode="clip")


def _make_radial_scale(camera: OmniCamera, min_height: float) -> Float32s | None:
    """Return pixels per unit of a direction at heights from `lowest` to 1, in fine enough steps."""
    steps = _MIN_STEPS
    while steps <= _MAX_STEPS:
        angle = np.arccos(np.linspace(min_height, 1.0, steps + 1)[:-1])
        scale = _radius_px(camera, angle) / np.sin(angle)
        seen = angle <= camera.rim_rad
        # A height is at most half a step away from its entry.
        error_px = 0.5 * np.abs(np.diff(scale[seen])) * np.sin(angle[seen][1:])
        if error_px.max(initial=0.0) < 0.5 * MAX_PIXEL_ERROR_PX:
            scale[0] = _OUTSIDE_PX
            return np.append(scale, scale[-1]).astype(np.float32)
        steps *= 2
    return None


def _radius_px(camera: OmniCamera, theta: Floats) -> Floats:
    """Return image radii; half way from the rim to the asymptote they stop growing.

    What lies beyond the rim is not shown, it is only followed there, and so never jumps.
    """
    asymptote_rad = 2.0 * math.atan(camera.mirror.t_limit)
    end = camera.rim_rad + min(_BEYOND_RIM_RAD, 0.5 * (asymptote_rad - camera.rim_rad))
    t = np.tan(0.5 * np.minimum(theta, end))
    return camera.horizon_radius_px * camera.mirror.radius_ratio_from_t(t)
