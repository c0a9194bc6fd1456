"""Diffraction: the lens's aperture spreads every point to Airy's pattern, red farther than blue.

A round aperture shows a point as (2 J1(v) / v)^2, v = pi r / (lambda N): a disc, which holds 83.8 %
of the light within a first dark ring of diameter 2.44 lambda N, and rings around it. A pixel's
weight is the pattern's integral over its square, around a point in the middle of its own; for each
colour with one wavelength that stands for its filter's band. The pattern never ends: beyond r a
share of 2 lambda N / (pi^2 r) is left. It is cut at a square five times as wide as the disc, beyond
which up to 3 % of the light lie (`lost_share`), and brought back to a sum of 1: no light is lost.
Source: Airy 1835; encircled light 1 - J0^2 - J1^2, Rayleigh 1881. Domain: a lens without other
faults, the same all over the picture; the f-number is that of the image's side.

Criterion: the radius of the first dark ring, in red: so far from its place the light of what a
pixel shows comes. Up to half a pixel it stays in its own, but for less than the rings' 16 %.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.defocus import F_NUMBER, PIXEL_PITCH
from catoptra_server.effects.effect import PIXELS, Bound, Kind, Real, Uniforms
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.effects.shared.symmetric_kernels import gathered, pair_sizes, pairs

# Assumed: the middles of the bands of a sensor's red, green and blue filters.
WAVELENGTHS_M = (610e-9, 540e-9, 465e-9)
# The first zero of J1, over pi: the dark ring's radius over lambda N.
_DARK_RING = 3.8317059702075125 / math.pi
# The kernel's square against the disc.
_WIDTHS = 5.0
# Radians of v between two places where the pattern is evaluated, at most: 5 a ring.
_STEP = 0.6


@dataclass(frozen=True, slots=True)
class Diffraction:
    """f_number: focal length over diameter. pixel_pitch_m: from pixel to pixel."""

    f_number: float
    pixel_pitch_m: float

    name: ClassVar[str] = "Diffraction"
    unit: ClassVar[str] = PIXELS
    uses_range: ClassVar[bool] = False

    def airy_diameter_px(self, wavelength_m: float) -> float:
        """Return the diameter of the first dark ring."""
        return 2.0 * _DARK_RING * self._unit_px(wavelength_m)

    def _unit_px(self, wavelength_m: float) -> float:
        """Return lambda N in px."""
        return wavelength_m * self.f_number / self.pixel_pitch_m

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return the radius of the first dark ring in red."""
        diameter = self.airy_diameter_px(WAVELENGTHS_M[0])
        return Bound(
            0.5 * diameter, f"at F/{self.f_number:g} the Airy disc of red is {diameter:.2f} px wide"
        )

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: no pixel gets brighter than the brightest around it."""
        return summary

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the picture with every point spread."""
        weights = kernels(self).astype(light.dtype)[:, :, None, None]
        return gathered(light, reach_px(self), lambda rows: weights)

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return the kernels."""
        return {"weights": _texture(self)}


def reach_px(effect: Diffraction) -> int:
    """Return how many pixels aside the kernel goes: with its own pixel, five discs in red."""
    half_px = 0.5 * _WIDTHS * effect.airy_diameter_px(WAVELENGTHS_M[0])
    return max(1, math.ceil(half_px - 0.5))


@lru_cache(maxsize=4)
def kernels(effect: Diffraction) -> Floats:
    """Return the (pairs, 3) weights of each colour, summing to 1 over all pixels."""
    weights = pattern(effect)
    weights /= pair_sizes(reach_px(effect)) @ weights
    weights.setflags(write=False)
    return weights


def lost_share(effect: Diffraction) -> Floats:
    """Return the (3,) shares of light that fall beyond the kernel, before its sum is made 1."""
    lost: Floats = 1.0 - pair_sizes(reach_px(effect)) @ pattern(effect)
    return lost


def pattern(effect: Diffraction) -> Floats:
    """Return the (pairs, 3) shares of a point's light in a pixel of each pair, uncut."""
    units = [effect._unit_px(wavelength) for wavelength in WAVELENGTHS_M]
    return np.stack([_pixel_shares(reach_px(effect), unit) for unit in units], axis=-1)


def _pixel_shares(reach: int, unit_px: float) -> Floats:
    """Return the (pairs,) integrals of Airy's pattern over pixels, by Gauss and Legendre."""
    count = 8 + math.ceil(math.pi / unit_px / _STEP)
    nodes, weights = np.polynomial.legendre.leggauss(count)
    at, weight = 0.5 * nodes, 0.5 * weights
    shares = [_intensity(np.hypot((i + at)[:, None], j + at), unit_px) for i, j in pairs(reach)]
    return np.array([weight @ share @ weight for share in shares])


def _intensity(radius_px: Floats, unit_px: float) -> Floats:
    """Return the share of light a px^2; the whole is 4 / pi unit_px^2 of the middle's."""
    v = math.pi * radius_px / unit_px
    shown: Floats = np.square(_twice_j1_over(v)) * (0.25 * math.pi / unit_px**2)
    return shown


def _twice_j1_over(v: Floats) -> Floats:
    """Return 2 J1(v) / v = mean over a half turn of 2 cos(v cos a) sin^2 a (Poisson's integral).

    The mean over equal steps of a smooth periodic function is exact once there are more than v.
    """
    count = 24 + math.ceil(float(v.max()))
    a = (np.arange(count) + 0.5) * (math.pi / count)
    total = np.zeros_like(v)
    for angle in a:
        total += np.cos(v * math.cos(angle)) * (2.0 * math.sin(angle) ** 2 / count)
    return total


@lru_cache(maxsize=4)
def _texture(effect: Diffraction) -> npt.NDArray[np.float32]:
    """Return the weights as the shader reads them, (1, pairs, 3)."""
    texture: npt.NDArray[np.float32] = kernels(effect).astype(np.float32)[None]
    return texture


KIND = Kind("Diffraction", Diffraction, (F_NUMBER, PIXEL_PITCH))
