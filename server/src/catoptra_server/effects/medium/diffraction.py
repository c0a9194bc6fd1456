"""Diffraction: the lens's aperture spreads every point to Airy's pattern, red farther than blue.

A round aperture shows a point as (2 J1(v) / v)^2, v = pi r / (lambda N): a disc, which holds 83.8 %
of the light within a first dark ring of diameter 2.44 lambda N, and rings around it. A pixel's
weight is the pattern's integral over its square, around a point in the middle of its own; for each
colour with one wavelength that stands for its filter's band. The pattern never ends: beyond r a
share of 2 lambda N / (pi^2 r) is left. It is cut at a square five times as wide as the disc, beyond
which up to 3 % of the light lie (`truncated_fraction`), and brought back to a sum of 1: no light is lost.
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

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import PIXELS, EffectBound, EffectType, Real, Uniforms
from catoptra_server.effects.kernels.symmetric_kernels import (
    convolve_symmetric,
    offset_pairs,
    pair_multiplicities,
)
from catoptra_server.effects.medium.defocus import F_NUMBER, PIXEL_PITCH
from catoptra_server.effects.scene_summary import SceneSummary

# Assumed: the middles of the bands of a sensor's red, green and blue filters.
WAVELENGTHS_M = (610e-9, 540e-9, 465e-9)
# The first zero of J1, over pi: the dark ring's radius over lambda N.
_FIRST_DARK_RING = 3.8317059702075125 / math.pi
# The kernel's square against the disc.
_KERNEL_WIDTH_IN_DISCS = 5.0
# Radians of v between two places where the pattern is evaluated, at most: 5 a ring.
_MAX_STEP_RAD = 0.6


@dataclass(frozen=True, slots=True)
class Diffraction:
    """f_number: focal length over diameter. pixel_pitch_m: from pixel to pixel."""

    f_number: float
    pixel_pitch_m: float

    name: ClassVar[str] = "Diffraction"
    unit: ClassVar[str] = PIXELS
    needs_range: ClassVar[bool] = False

    def airy_diameter_px(self, wavelength_m: float) -> float:
        """Return the diameter of the first dark ring."""
        return 2.0 * _FIRST_DARK_RING * self._lambda_n_px(wavelength_m)

    def _lambda_n_px(self, wavelength_m: float) -> float:
        """Return lambda N in px."""
        return wavelength_m * self.f_number / self.pixel_pitch_m

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return the radius of the first dark ring in red."""
        diameter = self.airy_diameter_px(WAVELENGTHS_M[0])
        return EffectBound(
            0.5 * diameter, f"at F/{self.f_number:g} the Airy disc of red is {diameter:.2f} px wide"
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: no pixel gets brighter than the brightest around it."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the picture with every point spread."""
        weights = kernel_weights(self).astype(image.dtype)[:, :, None, None]
        return convolve_symmetric(image, kernel_half_width_px(self), lambda rows: weights)

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return the kernels."""
        return {"weights": _weights_texture(self)}


def kernel_half_width_px(effect: Diffraction) -> int:
    """Return how many pixels aside the kernel goes: with its own pixel, five discs in red."""
    half_px = 0.5 * _KERNEL_WIDTH_IN_DISCS * effect.airy_diameter_px(WAVELENGTHS_M[0])
    return max(1, math.ceil(half_px - 0.5))


@lru_cache(maxsize=4)
def kernel_weights(effect: Diffraction) -> Floats:
    """Return the (pairs, 3) weights of each colour, summing to 1 over all pixels."""
    weights = airy_pattern(effect)
    weights /= pair_multiplicities(kernel_half_width_px(effect)) @ weights
    weights.setflags(write=False)
    return weights


def truncated_fraction(effect: Diffraction) -> Floats:
    """Return the (3,) shares of light that fall beyond the kernel, before its sum is made 1."""
    lost: Floats = 1.0 - pair_multiplicities(kernel_half_width_px(effect)) @ airy_pattern(effect)
    return lost


def airy_pattern(effect: Diffraction) -> Floats:
    """Return the (pairs, 3) shares of a point's light in a pixel of each pair, uncut."""
    units = [effect._lambda_n_px(wavelength) for wavelength in WAVELENGTHS_M]
    return np.stack(
        [_pixel_integrals(kernel_half_width_px(effect), unit) for unit in units], axis=-1
    )


def _pixel_integrals(half_width_px: int, lambda_n_px: float) -> Floats:
    """Return the (pairs,) integrals of Airy's pattern over pixels, by Gauss and Legendre."""
    count = 8 + math.ceil(math.pi / lambda_n_px / _MAX_STEP_RAD)
    nodes, weights = np.polynomial.legendre.leggauss(count)
    at, weight = 0.5 * nodes, 0.5 * weights
    shares = [
        _airy_intensity(np.hypot((i + at)[:, None], j + at), lambda_n_px)
        for i, j in offset_pairs(half_width_px)
    ]
    return np.array([weight @ share @ weight for share in shares])


def _airy_intensity(radius_px: Floats, lambda_n_px: float) -> Floats:
    """Return the share of light a px^2; the whole is 4 / pi unit_px^2 of the middle's."""
    v = math.pi * radius_px / lambda_n_px
    shown: Floats = np.square(_twice_j1_over(v)) * (0.25 * math.pi / lambda_n_px**2)
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
def _weights_texture(effect: Diffraction) -> npt.NDArray[np.float32]:
    """Return the weights as the shader reads them, (1, pairs, 3)."""
    texture: npt.NDArray[np.float32] = kernel_weights(effect).astype(np.float32)[None]
    return texture


EFFECT_TYPE = EffectType("Diffraction", Diffraction, (F_NUMBER, PIXEL_PITCH))
