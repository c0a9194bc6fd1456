"""Mirror dust: grains and scratches on the mirror hide what it shows and scatter light themselves.

L' = (1 - a) L + a w A: a(p) the share of a pixel's view that marks cover (`mirror_marks`), w their
albedo, A the mean light of the picture, which stands for all that shines on them. The lens is
focused at the mirror's virtual image, behind its surface: marks are blurred by the disc of what
touches the mirror (`lens_blur`). They stay where they are in every exposure, and differ from camera
to camera. Domain: central mirrors; of the light that marks scatter, how much depends on no angle.
Criterion: what white loses, or black gains, under the most that a camera's marks can cover of a
pixel.

That most holds for any camera: several grains in one pixel by Bernstein's inequality, such that no
pixel in 1e12 exceeds it (one that did would be cut to it).
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
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_sample_positions,
)
from catoptra_server.capture.noise_seed import NoiseSeed
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import (
    GREY_LEVELS,
    EffectBound,
    EffectParameter,
    EffectType,
    Real,
    Uniforms,
    float32_array,
)
from catoptra_server.effects.kernels.contaminants import (
    Contaminants,
    particle_cells,
    pixel_coverage,
    scratch_cells,
)
from catoptra_server.effects.kernels.disc_kernel import (
    DiscKernelTable,
    disc_kernel_table,
    table_row,
)
from catoptra_server.effects.kernels.grey_levels import grey_level, max_change_by_gain
from catoptra_server.effects.kernels.lens_blur import Aperture, circle_of_confusion_map
from catoptra_server.effects.kernels.mirror_surface_table import mirror_surface_table
from catoptra_server.effects.kernels.noise import camera_noise_key
from catoptra_server.effects.kernels.symmetric_kernels import convolve_symmetric
from catoptra_server.effects.medium.defocus import APERTURE_PARAMETERS
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.effects.sensor.auto_exposure import mean_luminance

# No pixel in so many has more on it, by its logarithm.
_LOG_RARITY = math.log(1e12)


@dataclass(frozen=True, slots=True)
class MirrorDust:
    """What lies on the mirror, the share of light that it scatters, and the lens that sees it."""

    contaminants: Contaminants
    albedo: float
    aperture: Aperture

    name: ClassVar[str] = "MirrorDust"
    unit: ClassVar[str] = GREY_LEVELS
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return what white loses where all is dark, or black gains where all else is white."""
        most = max_coverage(self, camera)
        lost = max_change_by_gain(1.0 - most, summary.max_radiance)
        gained = grey_level(most * self.albedo * summary.max_radiance)
        return EffectBound(max(lost, gained), f"marks cover up to {most:.2%} of what a pixel sees")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: marks scatter no more than the brightest light."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the picture in the dusty mirror."""
        covered = coverage_map(self, camera, context.noise_seed.camera_key).astype(
            image.dtype, copy=False
        )
        scattered = image.dtype.type(
            self._scattered_luminance(lambda: mean_luminance(image, camera))
        )
        return image + covered * (scattered - image)

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return what is covered, and the light of what covers it."""
        return {
            "covered": coverage_map(self, camera, context.noise_seed.camera_key),
            "scattered": float32_array(self._scattered_luminance(measure_mean_luminance)),
        }

    def _scattered_luminance(self, measure_mean_luminance: Callable[[], float]) -> float:
        """Return the light of marks; of black ones nothing is measured."""
        return self.albedo * measure_mean_luminance() if self.albedo else 0.0


@lru_cache(maxsize=8)
def coverage_map(
    effect: MirrorDust, camera: OmniCamera, camera_key: tuple[int, int]
) -> npt.NDArray[np.float32]:
    """Return the (h, w, 1) share of each pixel's view that a camera's marks cover."""
    chart, blur = mirror_surface_table(camera), _surface_blur(effect, camera)
    marks, of_camera = effect.contaminants, NoiseSeed(camera_key)
    grains = particle_cells(marks, camera, chart, camera_noise_key(of_camera, "dust"))
    lines = scratch_cells(marks, camera, chart, camera_noise_key(of_camera, "scratches"))
    sharp = np.minimum(pixel_coverage(grains, camera) + pixel_coverage(lines, camera), 1.0)
    soft = np.minimum(blur.blur(sharp), max_coverage(effect, camera))
    seen = direction_from_pixel(camera, pixel_sample_positions(camera))[1]
    covered = np.where(seen, soft[..., None], 0.0).astype(np.float32)
    covered.setflags(write=False)
    return covered


@lru_cache(maxsize=8)
def max_coverage(effect: MirrorDust, camera: OmniCamera) -> float:
    """Return the most that any camera's marks can cover of a pixel's view."""
    chart, marks, blur = (
        mirror_surface_table(camera),
        effect.contaminants,
        _surface_blur(effect, camera),
    )
    peak = blur.max_weight
    diameters = marks.particle_diameters_m(chart.area_m2)
    dust = 0.0
    if len(diameters):
        largest_px2 = 0.25 * math.pi * diameters[-1] ** 2 * chart.max_px2_per_m2
        grain = min(1.0, largest_px2 * peak)
        # Bernstein: the mean is the covered share, no grain adds more than the largest does.
        third = grain * _LOG_RARITY / 3.0
        crowd = (
            marks.coverage
            + third
            + math.hypot(third, math.sqrt(2 * marks.coverage * grain * _LOG_RARITY))
        )
        dust = min(len(diameters) * grain, crowd)
    width_px = marks.scratch_width_m * chart.max_px_per_m
    # A straight line is at most a diagonal long in a pixel, or in a kernel.
    line = math.sqrt(2.0) * width_px * min(1.0, peak * (2 * blur.kernel_table.half_width_px + 1))
    return min(1.0, dust + marks.num_scratches * min(1.0, line))


@dataclass(frozen=True, slots=True, eq=False)
class _SurfaceBlur:
    """The kernels of what touches the mirror; row: (h, w) of each pixel in the table."""

    kernel_table: DiscKernelTable
    table_row: Floats

    @property
    def max_weight(self) -> float:
        """Return the most that one pixel gives to another, or keeps."""
        return float(
            self.kernel_table.interpolate(
                self.table_row.min(keepdims=True), self.kernel_table.half_width_px
            ).max()
        )

    def blur(self, image: Floats) -> Floats:
        """Return a (h, w) picture as the lens sees it."""
        reach, row = self.kernel_table.half_width_px, self.table_row
        planes = np.repeat(image[..., None], 3, axis=-1)
        return convolve_symmetric(
            planes, reach, lambda rows: self.kernel_table.interpolate(row[rows], reach)
        )[..., 0]


@lru_cache(maxsize=4)
def _surface_blur(effect: MirrorDust, camera: OmniCamera) -> _SurfaceBlur:
    """Return how the lens blurs the mirror's own surface."""
    offset = pixel_sample_positions(camera)[:, :, 0] - camera.centre_px
    radius_px = np.minimum(np.hypot(offset[..., 0], offset[..., 1]), camera.rim_radius_px)
    t = camera.mirror.t_from_radius_ratio(radius_px / camera.horizon_radius_px)
    rho_m = np.hypot(*camera.mirror.surface_point(t))
    diameter = circle_of_confusion_map(effect.aperture, camera).diameter_px(rho_m)
    return _SurfaceBlur(disc_kernel_table(float(diameter.max())), table_row(diameter))


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
    marks = Contaminants(
        coverage,
        mean_particle_diameter_m,
        int(num_scratches),
        mean_scratch_length_m,
        scratch_width_m,
    )
    return MirrorDust(marks, albedo, Aperture(f_number, pixel_pitch_m, focus_distance_m))


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
)
