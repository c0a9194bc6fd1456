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

from catoptra_protocol.optics.camera import OmniCamera, direction_from_pixel, pixel_centres
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.auto_exposure import mean_of
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.defocus import APERTURE_PARAMETERS
from catoptra_server.effects.effect import (
    GREY_LEVELS,
    Bound,
    Kind,
    Parameter,
    Real,
    Uniforms,
    floats,
)
from catoptra_server.effects.frame_key import FrameKey
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.effects.shared.disc_kernel import DiscTable, disc_table, row_of
from catoptra_server.effects.shared.grey_levels import change_by_gain, grey_level
from catoptra_server.effects.shared.lens_blur import Aperture, pixel_law
from catoptra_server.effects.shared.mirror_chart import mirror_chart
from catoptra_server.effects.shared.mirror_marks import Marks, coverage, grain_cells, scratch_cells
from catoptra_server.effects.shared.noise import camera_words
from catoptra_server.effects.shared.symmetric_kernels import gathered

# No pixel in so many has more on it, by its logarithm.
_RARITY = math.log(1e12)


@dataclass(frozen=True, slots=True)
class MirrorDust:
    """What lies on the mirror, the share of light that it scatters, and the lens that sees it."""

    marks: Marks
    albedo: float
    aperture: Aperture

    name: ClassVar[str] = "MirrorDust"
    unit: ClassVar[str] = GREY_LEVELS
    uses_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return what white loses where all is dark, or black gains where all else is white."""
        most = most_covered(self, camera)
        lost = change_by_gain(1.0 - most, summary.largest_radiance)
        gained = grey_level(most * self.albedo * summary.largest_radiance)
        return Bound(max(lost, gained), f"marks cover up to {most:.2%} of what a pixel sees")

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: marks scatter no more than the brightest light."""
        return summary

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the picture in the dusty mirror."""
        covered = covered_map(self, camera, capture.key.camera).astype(light.dtype, copy=False)
        scattered = light.dtype.type(self._scattered(lambda: mean_of(light, camera)))
        return light + covered * (scattered - light)

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return what is covered, and the light of what covers it."""
        return {
            "covered": covered_map(self, camera, capture.key.camera),
            "scattered": floats(self._scattered(mean_light)),
        }

    def _scattered(self, mean_light: Callable[[], float]) -> float:
        """Return the light of marks; of black ones nothing is measured."""
        return self.albedo * mean_light() if self.albedo else 0.0


@lru_cache(maxsize=8)
def covered_map(
    effect: MirrorDust, camera: OmniCamera, key: tuple[int, int]
) -> npt.NDArray[np.float32]:
    """Return the (h, w, 1) share of each pixel's view that a camera's marks cover."""
    chart, blur = mirror_chart(camera), _blur(effect, camera)
    marks, of_camera = effect.marks, FrameKey(key)
    grains = grain_cells(marks, camera, chart, camera_words(of_camera, "dust"))
    lines = scratch_cells(marks, camera, chart, camera_words(of_camera, "scratches"))
    sharp = np.minimum(coverage(grains, camera) + coverage(lines, camera), 1.0)
    soft = np.minimum(blur.spread(sharp), most_covered(effect, camera))
    seen = direction_from_pixel(camera, pixel_centres(camera))[1]
    covered = np.where(seen, soft[..., None], 0.0).astype(np.float32)
    covered.setflags(write=False)
    return covered


@lru_cache(maxsize=8)
def most_covered(effect: MirrorDust, camera: OmniCamera) -> float:
    """Return the most that any camera's marks can cover of a pixel's view."""
    chart, marks, blur = mirror_chart(camera), effect.marks, _blur(effect, camera)
    peak = blur.largest_weight
    diameters = marks.diameters_m(chart.area_m2)
    dust = 0.0
    if len(diameters):
        largest_px2 = 0.25 * math.pi * diameters[-1] ** 2 * chart.largest_px2_per_m2
        grain = min(1.0, largest_px2 * peak)
        # Bernstein: the mean is the covered share, no grain adds more than the largest does.
        third = grain * _RARITY / 3.0
        crowd = (
            marks.cover + third + math.hypot(third, math.sqrt(2 * marks.cover * grain * _RARITY))
        )
        dust = min(len(diameters) * grain, crowd)
    width_px = marks.scratch_width_m * chart.largest_px_per_m
    # A straight line is at most a diagonal long in a pixel, or in a kernel.
    line = math.sqrt(2.0) * width_px * min(1.0, peak * (2 * blur.table.reach_px + 1))
    return min(1.0, dust + marks.scratches * min(1.0, line))


@dataclass(frozen=True, slots=True, eq=False)
class _Blur:
    """The kernels of what touches the mirror; row: (h, w) of each pixel in the table."""

    table: DiscTable
    row: Floats

    @property
    def largest_weight(self) -> float:
        """Return the most that one pixel gives to another, or keeps."""
        return float(self.table.mixed(self.row.min(keepdims=True), self.table.reach_px).max())

    def spread(self, sharp: Floats) -> Floats:
        """Return a (h, w) picture as the lens sees it."""
        reach, row = self.table.reach_px, self.row
        planes = np.repeat(sharp[..., None], 3, axis=-1)
        return gathered(planes, reach, lambda rows: self.table.mixed(row[rows], reach))[..., 0]


@lru_cache(maxsize=4)
def _blur(effect: MirrorDust, camera: OmniCamera) -> _Blur:
    """Return how the lens blurs the mirror's own surface."""
    offset = pixel_centres(camera)[:, :, 0] - camera.centre_px
    radius_px = np.minimum(np.hypot(offset[..., 0], offset[..., 1]), camera.rim_radius_px)
    t = camera.mirror.t_from_radius_ratio(radius_px / camera.horizon_radius_px)
    rho_m = np.hypot(*camera.mirror.surface(t))
    diameter = pixel_law(effect.aperture, camera).diameter_px(rho_m)
    return _Blur(disc_table(float(diameter.max())), row_of(diameter))


def _made(
    cover: float,
    diameter_m: float,
    scratches: float,
    scratch_length_m: float,
    scratch_width_m: float,
    albedo: float,
    f_number: float,
    pixel_pitch_m: float,
    focus_m: float,
) -> MirrorDust:
    marks = Marks(cover, diameter_m, int(scratches), scratch_length_m, scratch_width_m)
    return MirrorDust(marks, albedo, Aperture(f_number, pixel_pitch_m, focus_m))


KIND = Kind(
    "MirrorDust",
    _made,
    (
        Parameter("DustCover", "cover", 0.002, 0.0, 0.2),
        Parameter("DustDiameter", "diameter_m", 2e-4, 1e-5, 5e-3),
        Parameter("Scratches", "scratches", 2.0, 0.0, 1000.0),
        Parameter("ScratchLength", "scratch_length_m", 0.02, 1e-4, 1.0),
        Parameter("ScratchWidth", "scratch_width_m", 5e-5, 1e-7, 1e-2),
        Parameter("DustAlbedo", "albedo", 0.3, 0.0, 1.0),
        *APERTURE_PARAMETERS,
    ),
)
