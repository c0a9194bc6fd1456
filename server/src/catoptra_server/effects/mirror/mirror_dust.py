"""Mirror dust: particles and scratches cover the mirror and scatter light themselves.

L' = (1 - a) L + a w A: a(p) the fraction of a pixel's view that contaminants cover
(`mirror_surface`), w their albedo, A the mean radiance of the image in place of the irradiance on
them. The lens is focused at the mirror's virtual image, behind its surface: contaminants are
blurred by the disc of points on the mirror (`lens_blur`). Positions are constant for a camera and
differ between cameras. Domain: central mirrors; diffuse scattering, independent of the angle.
Criterion: the loss of white, or the gain of black, at the maximum coverage of a pixel: of this
camera's own map, or of any camera's where the camera is not known.

The maximum of any camera: several particles in one pixel by Bernstein's inequality, such that no
pixel in 1e12 exceeds the maximum (one that did would be cut).
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import hypot, ln
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    AVERAGING,
    NEEDS_MIRROR,
    CaptureContext,
    EffectBound,
    EffectParameter,
    EffectType,
    Gains,
    Real,
    SceneSummary,
)
from catoptra_server.effects.kernels.grey_levels import (
    camera_noise_key,
    grey_level,
    max_change_by_gain,
    mean_luminance,
    valid_pixels,
)
from catoptra_server.effects.kernels.lens_blur import Aperture
from catoptra_server.effects.kernels.mirror_surface import (
    Contaminants,
    mirror_surface_table,
    particle_cells,
    pixel_coverage,
    scratch_cells,
)
from catoptra_server.effects.kernels.near_blur import NearBlur, make_near_blur
from catoptra_server.effects.medium.defocus import APERTURE_PARAMETERS
from catoptra_server.world.objects import NoiseSeed

# Logarithm of the number of pixels of which none exceeds the maximum coverage.
_LOG_RARITY = ln(1e12)


@dataclass(frozen=True, slots=True)
class MirrorDust:
    """Contaminants on the mirror, and the lens that images them."""

    contaminants: Contaminants
    albedo: float
    """Fraction of light that contaminants scatter."""
    aperture: Aperture

    name: ClassVar[str] = "MirrorDust"
    changes_scene: ClassVar[bool] = False
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance", "camera_key"})
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Loss of white in a dark image, or gain of black in a white image: the larger."""
        assert isinstance(camera, OmniCamera), NEEDS_MIRROR
        # The map of a camera is needed with the first frame that shows it, so its own maximum is
        # known: the bound for all cameras is several times as large.
        coverage = (
            max_coverage(self, camera)
            if summary.camera_key is None
            else float(coverage_map(self, camera, summary.camera_key).max())
        )
        loss = max_change_by_gain(1.0 - coverage, summary.picture_radiance)
        gain = grey_level(coverage * self.albedo * summary.picture_radiance)
        return EffectBound(max(loss, gain), f"dust covers up to {coverage:.2%} of a pixel's view")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: contaminants scatter no more than the brightest light."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Mix the image with the scattered light by coverage."""
        assert isinstance(camera, OmniCamera), NEEDS_MIRROR
        coverage = coverage_map(self, camera, context.noise_seed.camera_key).astype(
            image.dtype, copy=False
        )
        # The same for all colours.
        scattered = image.dtype.type(self.albedo * mean_luminance(image, camera))
        return image + coverage * (scattered - image)


@lru_cache(maxsize=8)
def coverage_map(
    effect: MirrorDust, camera: OmniCamera, camera_key: tuple[int, int]
) -> npt.NDArray[np.float32]:
    """Fraction of each pixel's view that a camera's contaminants cover, (h, w, 1)."""
    surface_table, blur = mirror_surface_table(camera), _surface_blur(effect, camera)
    contaminants, seed = effect.contaminants, NoiseSeed(camera_key)
    particles = particle_cells(contaminants, camera, surface_table, camera_noise_key(seed, "dust"))
    scratches = scratch_cells(
        contaminants, camera, surface_table, camera_noise_key(seed, "scratches")
    )
    sharp = np.minimum(pixel_coverage(particles, camera) + pixel_coverage(scratches, camera), 1.0)
    # Cut at the bound, so the criterion holds even for the one pixel in 1e12.
    soft = np.minimum(blur.blur(sharp), max_coverage(effect, camera))
    coverage = np.where(valid_pixels(camera), soft, 0.0).astype(np.float32)[..., None]
    coverage.setflags(write=False)
    return coverage


@lru_cache(maxsize=8)
def max_coverage(effect: MirrorDust, camera: OmniCamera) -> float:
    """Largest fraction of a pixel's view that the contaminants of any camera cover."""
    surface_table, contaminants = mirror_surface_table(camera), effect.contaminants
    blur = _surface_blur(effect, camera)
    peak = blur.max_weight
    diameters = contaminants.particle_diameters_m(surface_table.area_m2)
    dust = 0.0
    if len(diameters):
        largest_px2 = 0.25 * math.pi * diameters[-1] * diameters[-1] * surface_table.max_px2_per_m2
        particle = min(1.0, largest_px2 * peak)
        # Bernstein's inequality: the mean is the coverage, and no particle adds more than the
        # largest one does.
        third = particle * _LOG_RARITY / 3.0
        spread = math.sqrt(2 * contaminants.coverage * particle * _LOG_RARITY)
        crowd = contaminants.coverage + third + hypot(third, spread)
        # Few particles cannot cover more than all of them in one pixel.
        dust = min(len(diameters) * particle, crowd)
    width_px = contaminants.scratch_width_m * surface_table.max_px_per_m
    # A straight line in a pixel, or in a kernel, is at most a diagonal long.
    kernel_side_px = 2 * blur.kernel_table.half_width_px + 1
    scratch = math.sqrt(2.0) * width_px * min(1.0, peak * kernel_side_px)
    return min(1.0, dust + contaminants.num_scratches * min(1.0, scratch))


@lru_cache(maxsize=4)
def _surface_blur(effect: MirrorDust, camera: OmniCamera) -> NearBlur:
    """Blur of the mirror's own surface by the lens."""

    def range_m(radius_px: Floats) -> Floats:
        t = camera.projection.t_from_radius_ratio(radius_px / camera.scale_px)
        # A point on the mirror has the range of its own distance from the viewpoint.
        return hypot(*camera.mirror.surface_point(t))

    return make_near_blur(effect.aperture, camera, range_m)


def _create_effect(
    coverage: float,
    mean_particle_diameter_m: float,
    num_scratches: float,
    mean_scratch_length_m: float,
    scratch_width_m: float,
    albedo: float,
    f_number: float,
    pixel_pitch_m: float,
    focus_distance_m: float,
) -> MirrorDust:
    contaminants = Contaminants(
        coverage,
        mean_particle_diameter_m,
        int(num_scratches),
        mean_scratch_length_m,
        scratch_width_m,
    )
    return MirrorDust(contaminants, albedo, Aperture(f_number, pixel_pitch_m, focus_distance_m))


EFFECT_TYPE = EffectType(
    "MirrorDust",
    _create_effect,
    (
        EffectParameter("DustCoverage", "coverage", 0.002, 0.0, 0.2),
        EffectParameter("DustDiameter", "mean_particle_diameter_m", 2e-4, 1e-5, 5e-3),
        EffectParameter("Scratches", "num_scratches", 2.0, 0.0, 1000.0),
        EffectParameter("ScratchLength", "mean_scratch_length_m", 0.02, 1e-4, 1.0),
        EffectParameter("ScratchWidth", "scratch_width_m", 5e-5, 1e-7, 1e-2),
        EffectParameter("DustAlbedo", "albedo", 0.3, 0.0, 1.0),
        *APERTURE_PARAMETERS,
    ),
    needs_mirror=True,
)
