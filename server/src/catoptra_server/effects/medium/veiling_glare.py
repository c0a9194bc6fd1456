"""Veiling glare: the lens scatters part of its light over all of the picture.

L' = (1 - g) L + g (S * (L + P)): g the fraction of light that lens and housing scatter, S its
spread, P the light of the sources in view. A black spot in a wide white field receives g of the
white, which is the veiling glare index of ISO 9358 (1 to 3 % of photographic lenses). Two shares:

* of polished surfaces S = k / (1 + (r / w)^2): the Harvey-Shack (ABC) scatter function
  A / (1 + (B b)^2)^(C / 2) of a distance b in direction cosines, which a lens maps to a distance r
  on the sensor; shoulder w = f / B, slope C = 2 (1 to 3 of polished surfaces). Source: Harvey 1976;
  Dittman, K-correlation power spectral density & surface scatter model, Proc. SPIE 6291, 2006;
* of reflections between surfaces, barrel and sensor: the same everywhere, a fraction v of it.

k is 1 over the sum of S over all distances that the picture has, so that no light is gained; what
is scattered beyond the picture is lost. S is wide, so scattered light is computed in square cells,
at most 40 along a side: from each cell's mean to the cells' centres, and bilinear between them.
Error: where S * L bends within a cell, along the borders of the brightest parts. With the default
shoulder, in a half-white picture, it is below 7 % of what is scattered, 0.14 % of white at g = 2 %
(`tests/server/effects/medium/test_veiling_glare.py`).

Lamps and the sun are no surfaces of a scene, but their light enters the lens where they are in view
(`light_sources`), and is scattered around their places, by S itself at each pixel. A light of
irradiance E at the viewpoint has as much light as a surface of radiance pi E on one steradian:
pi E dA/dOmega in units of pixels times radiance, dA/dOmega the image's area per solid angle. A
white facet lit by E has radiance E here: the factor pi. Their own images, no larger than a pixel,
are not drawn; the mirror's reflectance at their places is neglected.

Domain: all cameras; light before the sensor, not clipped; the same S all over the picture. Bound:
black that receives g of the brightest and the sources' glare, or the brightest that loses g.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import matmul
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    AVERAGING,
    CaptureContext,
    EffectBound,
    EffectParameter,
    EffectType,
    Gains,
    Real,
    SceneSummary,
)
from catoptra_server.effects.kernels.grey_levels import grey_level, max_change_by_gain
from catoptra_server.effects.kernels.light_sources import source_light_px
from catoptra_server.effects.medium.defocus import PIXEL_PITCH

# Along the longer side: 1600 cells exchange light in a millisecond.
_MAX_CELLS = 40


@dataclass(frozen=True, slots=True)
class VeilingGlare:
    """Scatter of a lens."""

    index: float
    """Fraction g of the light that is scattered: the veiling glare index."""
    veil_fraction: float
    """Fraction v of it that is the same everywhere."""
    shoulder_m: float
    """Distance on the sensor within which the spread of the rest is flat."""
    pixel_pitch_m: float
    """Distance between the centres of adjacent pixels."""

    name: ClassVar[str] = "VeilingGlare"
    changes_scene: ClassVar[bool] = False
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance", "source_light_px"})
    # Where a surface is nearer than a light, it hides the light.
    needs_range: ClassVar[bool] = True

    @property
    def shoulder_px(self) -> float:
        """Shoulder of the spread; a pixel at least, since pixels do not resolve less."""
        return max(self.shoulder_m / self.pixel_pitch_m, 1.0)

    @property
    def least_area_px(self) -> float:
        """Area over which light is spread at least, in any camera: 1 / S within one shoulder alone,
        pi ln 2 = 2.18 of its squares, rounded down."""
        return 2.0 * self.shoulder_px * self.shoulder_px

    def _max_source_glare(self, summary: SceneSummary) -> float:
        return self.index * summary.source_light_px / self.least_area_px

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Gain of black beside the brightest light, or the loss of that light: the larger."""
        loss = max_change_by_gain(1.0 - self.index, summary.picture_radiance)
        from_sources = summary.gains[1] * self._max_source_glare(summary)
        gain = grey_level(self.index * summary.picture_radiance + from_sources)
        return EffectBound(max(loss, gain), f"the lens scatters {self.index:.2%} of its light")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary with the glare of sources; a mean is not brighter than its brightest pixel."""
        return replace(summary, max_radiance=summary.max_radiance + self._max_source_glare(summary))

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Scatter a part of the image and of the sources in view."""
        spread = glare_spread(self, camera)
        scattered = _interpolate(spread, _exchange(spread, image.astype(np.float64)), camera)
        scattered += spread.veil * image.sum(axis=(0, 1), dtype=np.float64)
        centres = pixel_sample_positions(camera)[:, :, 0]
        for source in source_glare(self, camera, context):
            squares = np.square(centres - source[:2]).sum(axis=-1)
            shape = 1.0 / (1.0 + spread.inverse_square * squares)
            scattered += shape[..., None] * source[2:5] + source[5:]
        mixed: npt.NDArray[Real] = ((1.0 - self.index) * image + scattered).astype(image.dtype)
        return mixed


@dataclass(frozen=True, slots=True, eq=False)
class GlareSpread:
    """Spread of one effect in one camera, times g."""

    cell_px: int
    """Side of a cell."""
    kernel: Floats
    """(rows, columns) light that a cell's centre receives from a mean of 1 as many cells away."""
    peak: float
    """S of polished surfaces at its centre, a pixel's light."""
    veil: float
    """What each pixel receives of a pixel's light."""
    inverse_square: float
    """1 / w^2, per px^2."""


@lru_cache(maxsize=4)
def glare_spread(effect: VeilingGlare, camera: RadialCamera) -> GlareSpread:
    """Spread of scattered light by distance."""
    size = (camera.height_px, camera.width_px)
    cell_px = -(-max(size) // _MAX_CELLS)
    rows, columns = (-(-side // cell_px) for side in size)
    inverse_square = 1.0 / (effect.shoulder_px * effect.shoulder_px)
    # From a cell's centre to the pixels of the cells below and right of it.
    v, u = (np.arange(count * cell_px) - 0.5 * (cell_px - 1) for count in (rows, columns))
    shape = 1.0 / (1.0 + inverse_square * (np.square(v)[:, None] + np.square(u)))
    sums = shape.reshape(rows, cell_px, columns, cell_px).sum(axis=(1, 3))
    # Cells off the centre's row and column lie above and left of it, too.
    repeats = [np.where(np.arange(count) > 0, 2.0, 1.0) for count in (rows, columns)]
    total = float((sums * repeats[0][:, None] * repeats[1]).sum())
    scale = effect.index * (1.0 - effect.veil_fraction) / max(total, effect.least_area_px)
    area_px = max(float(camera.width_px * camera.height_px), effect.least_area_px)
    veil = effect.index * effect.veil_fraction / area_px
    return GlareSpread(cell_px, scale * sums, scale, veil, inverse_square)


@lru_cache(maxsize=4)
def glare_kernel(effect: VeilingGlare, camera: RadialCamera) -> npt.NDArray[np.float32]:
    """Kernel of the spread for the native stage: columns from -(columns - 1) on."""
    kernel = glare_spread(effect, camera).kernel.astype(np.float32)
    return np.ascontiguousarray(np.concatenate((kernel[:, :0:-1], kernel), axis=1))


def source_glare(effect: VeilingGlare, camera: RadialCamera, context: CaptureContext) -> Floats:
    """Rows of pixel (u, v), RGB of the glare's peak and RGB of its veil, (n, 8)."""
    spread = glare_spread(effect, camera)
    rows = [
        (*source.pixel, *(spread.peak * light), *(spread.veil * light))
        for source in context.sources
        for light in [source_light_px(source, camera)]
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 8)


def _exchange(spread: GlareSpread, image: Floats) -> Floats:
    """Scattered light at the centres of cells, (rows, columns, 3)."""
    rows, columns = spread.kernel.shape
    side = spread.cell_px
    whole = np.zeros((rows * side, columns * side, 3))
    whole[: image.shape[0], : image.shape[1]] = image
    means = whole.reshape(rows, side, columns, side, 3).sum(axis=(1, 3)) / (side * side)
    apart = np.abs(np.arange(columns)[:, None] - np.arange(columns))
    received: Floats = np.zeros_like(means)
    for distance, weights in enumerate(spread.kernel):
        mixed = matmul(weights[apart], means)
        received[distance:] += mixed[: rows - distance]
        if distance:
            received[: rows - distance] += mixed[distance:]
    return received


def _interpolate(spread: GlareSpread, received: Floats, camera: RadialCamera) -> Floats:
    """Bilinear interpolation of light at the centres of cells, (h, w, 3)."""
    for axis, count in enumerate((camera.height_px, camera.width_px)):
        last = received.shape[axis] - 1
        place = np.clip((np.arange(count) + 0.5) / spread.cell_px - 0.5, 0.0, last)
        before = np.minimum(place.astype(np.intp), max(last - 1, 0))
        shape = [1, 1, 1]
        shape[axis] = count
        fraction = (place - before).reshape(shape)
        after = received.take(np.minimum(before + 1, last), axis=axis)
        mixed: Floats = (1.0 - fraction) * received.take(before, axis=axis) + fraction * after
        received = mixed
    return received


EFFECT_TYPE = EffectType(
    "VeilingGlare",
    VeilingGlare,
    (
        EffectParameter("VeilingGlareIndex", "index", 0.02, 0.0, 0.5),
        # Half: the power law alone would leave the far side of the picture nearly black.
        EffectParameter("GlareVeil", "veil_fraction", 0.5, 0.0, 1.0),
        # 7 px of 7.4 um; 1 / B = 0.01 rad (Harvey-Shack) at a focal length of 5 mm.
        EffectParameter("GlareShoulder", "shoulder_m", 5e-5, 1e-6, 1e-2),
        PIXEL_PITCH,
    ),
)
