"""Diffraction: the lens's aperture spreads every point to an Airy pattern, red wider than blue.

A circular aperture images a point as (2 J1(v) / v)^2, v = pi r / (lambda N): a disc with 83.8 % of
the light within a first dark ring of diameter 2.44 lambda N, and rings around. A pixel's weight is
the pattern's integral over its square, for a point at the centre of the central pixel; each colour
has one wavelength in place of its filter's band. The pattern never ends: beyond r a fraction of 2
lambda N / (pi^2 r) remains. The kernel is cut at a square five times as wide as the disc, which
loses up to 3 %, and normalized to a sum of 1: no light is lost. Source: Airy 1835; encircled energy
1 - J0^2 - J1^2, Rayleigh 1881. Domain: a lens without other aberrations, the same everywhere in the
image; the f-number is the image side's.

Criterion: the fraction of light that other pixels receive, beside the central weight, times the
contrast of black and the brightest. The displacement is the radius of the first dark ring in red.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.curves import gauss_legendre
from catoptra_protocol.optics.elementary import cos, hypot, matmul, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    AVERAGING,
    CaptureContext,
    EffectBound,
    EffectType,
    Gains,
    ParameterFault,
    Real,
    SceneSummary,
)
from catoptra_server.effects.kernels.convolution import (
    convolve_symmetric,
    offset_pairs,
    pair_multiplicities,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_exchange
from catoptra_server.effects.medium.defocus import F_NUMBER, PIXEL_PITCH

# Assumed: the centres of the bands of a sensor's red, green and blue filters.
WAVELENGTHS_M = (610e-9, 540e-9, 465e-9)
# The first zero of J1, over pi: the dark ring's radius over lambda N.
_FIRST_DARK_RING = 3.8317059702075125 / math.pi
_MAX_AIRY_DIAMETER_PX = 24.0
"""Widest Airy disc of red that robot files may ask for: F/64 on pixels of 4 um."""
# Width of the kernel's square over the diameter of the disc.
_KERNEL_WIDTH_IN_DISCS = 5.0
# Narrower patterns have more rings in a pixel than quadrature should resolve: 300 nodes.
_MIN_RESOLVED_PX = 0.018
# Largest step of v between two quadrature nodes: 5 nodes per ring.
_MAX_STEP_RAD = 0.6


@dataclass(frozen=True, slots=True)
class Diffraction:
    """Aperture of the lens and pixel size."""

    f_number: float
    """Focal length over diameter of the aperture."""
    pixel_pitch_m: float
    """Distance between the centres of adjacent pixels."""

    name: ClassVar[str] = "Diffraction"
    changes_scene: ClassVar[bool] = False
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    def airy_diameter_px(self, wavelength_m: float) -> float:
        """Diameter of the first dark ring."""
        return 2.0 * _FIRST_DARK_RING * self._lambda_n_px(wavelength_m)

    def airy_pattern(self) -> Floats:
        """Fraction of a point's light in a pixel of each pair, (pairs, 3), not normalized."""
        half_width_px = kernel_half_width_px(self)
        units_px = [self._lambda_n_px(wavelength) for wavelength in WAVELENGTHS_M]
        return np.stack([_pixel_integrals(half_width_px, unit) for unit in units_px], axis=-1)

    def _lambda_n_px(self, wavelength_m: float) -> float:
        """Unit of length of the pattern, lambda N, in px."""
        return wavelength_m * self.f_number / self.pixel_pitch_m

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Bound the change by the light that reaches other pixels; red spreads most."""
        diameter = self.airy_diameter_px(WAVELENGTHS_M[0])
        return EffectBound(
            max_change_by_exchange(1.0 - kernel_weights(self)[0].min(), summary.picture_radiance),
            f"at F/{self.f_number:g} the Airy disc of red is {diameter:.2f} px wide",
            0.5 * diameter,
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: a weighted mean is not brighter than its brightest pixel."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Convolve the image with the pattern of each colour."""
        weights = kernel_weights(self).astype(image.dtype)[:, :, None, None]
        return convolve_symmetric(image, kernel_half_width_px(self), lambda rows: weights)


def kernel_half_width_px(effect: Diffraction) -> int:
    """Half width of the kernel without the central pixel: five discs of red in all."""
    half_px = 0.5 * _KERNEL_WIDTH_IN_DISCS * effect.airy_diameter_px(WAVELENGTHS_M[0])
    # At least the direct neighbours, however narrow the pattern: an enabled effect has a kernel.
    return max(1, math.ceil(half_px - 0.5))


@lru_cache(maxsize=4)
def kernel_weights(effect: Diffraction) -> Floats:
    """Weights of each colour, (pairs, 3), whose sum over all pixels is 1."""
    weights = effect.airy_pattern()
    weights /= matmul(pair_multiplicities(kernel_half_width_px(effect)), weights)
    weights.setflags(write=False)
    return weights


def _pixel_integrals(half_width_px: int, lambda_n_px: float) -> Floats:
    """Integrals of the Airy pattern over pixels, (pairs,)."""
    if lambda_n_px < _MIN_RESOLVED_PX:
        return _integrals_of_point(half_width_px, lambda_n_px)
    return _integrals_by_quadrature(half_width_px, lambda_n_px)


def _integrals_of_point(half_width_px: int, lambda_n_px: float) -> Floats:
    """Integrals of a pattern far narrower than a pixel: the mean over its rings beside the centre.

    J1(v)^2 is 1 / (pi v) in the mean for large v, so the intensity is lambda_n_px / (pi^3 r^3) per
    px^2; what is left is in the central pixel.
    """
    nodes, weights = gauss_legendre(24)
    position, weight = 0.5 * nodes, 0.5 * weights
    integrals = np.zeros(len(pair_multiplicities(half_width_px)))
    for pair, (i, j) in enumerate(offset_pairs(half_width_px)):
        if pair:
            radius_px = hypot((i + position)[:, None], j + position)
            intensity = lambda_n_px / (
                math.pi * math.pi * math.pi * radius_px * radius_px * radius_px
            )
            integrals[pair] = matmul(matmul(weight, intensity), weight)
    integrals[0] = 1.0 - matmul(pair_multiplicities(half_width_px), integrals)
    return integrals


def _integrals_by_quadrature(half_width_px: int, lambda_n_px: float) -> Floats:
    """Integrals over pixels by Gauss-Legendre quadrature."""
    # Nodes by the pattern's scale: a large pixel pitch packs several rings into one pixel.
    count = 8 + math.ceil(math.pi / lambda_n_px / _MAX_STEP_RAD)
    nodes, weights = gauss_legendre(count)
    position, weight = 0.5 * nodes, 0.5 * weights
    intensities = [
        _airy_intensity(hypot((i + position)[:, None], j + position), lambda_n_px)
        for i, j in offset_pairs(half_width_px)
    ]
    return np.array([matmul(matmul(weight, intensity), weight) for intensity in intensities])


def _airy_intensity(radius_px: Floats, lambda_n_px: float) -> Floats:
    """Fraction of light per px^2 at a radius; the total is 4 / pi lambda_n_px^2 of the centre's."""
    v = math.pi * radius_px / lambda_n_px
    intensity: Floats = np.square(_twice_j1_over(v)) * (
        0.25 * math.pi / (lambda_n_px * lambda_n_px)
    )
    return intensity


def _twice_j1_over(v: Floats) -> Floats:
    """Evaluate 2 J1(v) / v as the mean over a half turn of 2 cos(v cos a) sin^2 a.

    Poisson's integral: no division by v = 0, and no SciPy.
    """
    # The trapezoidal rule of a smooth periodic function is exact to rounding once there are more
    # nodes than v.
    count = 24 + math.ceil(float(v.max()))
    angles = (np.arange(count) + 0.5) * (math.pi / count)
    total = np.zeros_like(v)
    for angle in angles:
        total += cos(v * cos(angle)) * (2.0 * sin(angle) * sin(angle) / count)
    return total


def _find_fault(effect: Diffraction) -> ParameterFault | None:
    """Find a pattern too wide to be drawn.

    F/64 on pixels of 0.1 um would take a border of 2400 px and three million weights.
    """
    diameter_px = effect.airy_diameter_px(WAVELENGTHS_M[0])
    if diameter_px <= _MAX_AIRY_DIAMETER_PX:
        return None
    pitch_m = effect.pixel_pitch_m * diameter_px / _MAX_AIRY_DIAMETER_PX
    return ParameterFault(
        PIXEL_PITCH.key,
        f"at least {pitch_m:.2g} m at F/{effect.f_number:g}, where the Airy disc of red would be "
        f"{diameter_px:.0f} px wide: Diffraction draws discs of at most "
        f"{_MAX_AIRY_DIAMETER_PX:g} px",
    )


EFFECT_TYPE = EffectType(
    "Diffraction", Diffraction, (F_NUMBER, PIXEL_PITCH), find_fault=_find_fault
)
