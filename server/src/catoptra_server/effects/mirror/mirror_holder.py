"""Mirror holder: a glass tube, or struts, between the mirror and its capture camera.

A central mirror turns the chief ray of a pixel to the line through the viewpoint at the angle theta
from the axis. Around the axis, at the radius D, the holder reaches from the mirror to the height of
the pinhole, h: a ray passes it at the height D cot(theta), where that is below h. A holder narrower
than the mirror stands at its rim.

Tube, L' = (T L + R T L*) / T(0): the wall is a slab that rays meet at the angle of incidence
i = |90 degrees - theta|, in the plane of axis and normal. A surface reflects r by Fresnel, the slab
R = 2 r / (1 + r), T = 1 - R, of each polarization; both in the mean. Relative to T(0), since the
exposure compensates a loss that all pixels share. L* is the ghost: light that came in through the
opposite side and is reflected once at the inner wall, of the direction theta at the opposite
azimuth, if on its way from (-D, 3 D cot(theta)) over the axis to (D, D cot(theta)) it meets no
mirror, and has passed the tube: 3 D cot(theta) < h. The ghost is sharp and in the opposite pixel,
the nearest one where the image's centre lies off the middle of pixels; objects are far compared
with 2 D. Rays that are reflected more often, R^2 = 0.6 %, are lost. Source: Fresnel; incoherent
sum of a slab's reflections; the rest is derived here.

Struts, L' = (1 - a) L + a w A, as dust: a strut of width W covers the azimuths within
arcsin(W / 2D) of its own, the fraction a of a pixel; w is its albedo, A the mean luminance of the
image. A lens that is focused at the mirror's virtual image blurs it as an object at D / sin(theta).

Domain: central mirrors; grey glass; no shadow of the holder on the mirror. Bound: the largest gain
or loss of the holder's own maps.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import arcsin, arctan2, hypot
from catoptra_protocol.optics.image_plane import pixel_sample_positions
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
    grey_level,
    max_change_by_gain,
    mean_luminance,
)
from catoptra_server.effects.kernels.lens_blur import Aperture, map_of_radius
from catoptra_server.effects.kernels.near_blur import make_near_blur
from catoptra_server.effects.medium.defocus import APERTURE_PARAMETERS

# Points of the mirror that may be in a ghost's way.
_NUM_POINTS = 129


@dataclass(frozen=True, slots=True)
class MirrorHolder:
    """Tube or struts around the axis."""

    num_struts: int
    """0: a tube."""
    distance_m: float
    """Of the tube's wall or the struts from the axis."""
    refractive_index: float
    """Of the tube."""
    strut_width_m: float
    azimuth_rad: float
    """Of the first strut about the axis, from the mirror's x towards y."""
    albedo: float
    """Of the struts."""
    aperture: Aperture

    name: ClassVar[str] = "MirrorHolder"
    changes_scene: ClassVar[bool] = False
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    @property
    def gains(self) -> Gains:
        """T + R T is at most 1, of each polarization; relative to T(0)."""
        return AVERAGING if self.num_struts else (0.0, 1.0 / self._normal_transmittance)

    @property
    def _normal_transmittance(self) -> float:
        return float(self._slab(np.array(1.0))[0])

    def _slab(self, cosine: Floats) -> tuple[Floats, Floats]:
        """T, and R T, of cosines of angles of incidence."""
        n = self.refractive_index
        inside = np.sqrt(1.0 - (1.0 - np.square(cosine)) / (n * n))
        ratios = (
            (cosine - n * inside) / (cosine + n * inside),
            (n * cosine - inside) / (n * cosine + inside),
        )
        reflected = [2.0 * np.square(r) / (1.0 + np.square(r)) for r in ratios]
        transmitted = 1.0 - 0.5 * (reflected[0] + reflected[1])
        return transmitted, 0.5 * sum((r * (1.0 - r) for r in reflected), start=np.zeros(()))

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Largest loss of the brightest light, or gain of black beside it."""
        assert isinstance(camera, OmniCamera), NEEDS_MIRROR
        brightest = summary.picture_radiance
        if self.num_struts:
            covered = float(strut_coverage(self, camera).max())
            loss = max_change_by_gain(1.0 - covered, brightest)
            gain = grey_level(covered * self.albedo * brightest)
            return EffectBound(max(loss, gain), f"struts cover up to {covered:.0%} of a pixel")
        direct, ghost = tube_maps(self, camera)
        loss = max_change_by_gain(float(direct.min()), brightest)
        gained = max(float(direct.max()) - 1.0, 0.0) + float(ghost.max())
        reason = f"a tube shows up to {float(ghost.max()):.1%} of the opposite side"
        return EffectBound(max(loss, grey_level(gained * brightest)), reason)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of light that passes the tube and its ghost."""
        return replace(summary, max_radiance=self.gains[1] * summary.max_radiance)

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Cover the image by struts, or mix it with its ghost."""
        assert isinstance(camera, OmniCamera), NEEDS_MIRROR
        if self.num_struts:
            coverage = strut_coverage(self, camera)[..., None].astype(image.dtype)
            scattered = image.dtype.type(self.albedo * mean_luminance(image, camera))
            return image + coverage * (scattered - image)
        direct, ghost = (one[..., None].astype(image.dtype) for one in tube_maps(self, camera))
        columns, rows = (
            np.clip(last - np.arange(count), 0, count - 1)
            for last, count in zip(opposite_sums(camera), image.shape[1::-1], strict=True)
        )
        mixed: npt.NDArray[Real] = image * direct + image[rows[:, None], columns] * ghost
        return mixed


def opposite_sums(camera: OmniCamera) -> tuple[int, int]:
    """Sum of the columns of two opposite pixels, and of their rows."""
    u, v = camera.centre_px
    return math.floor(2.0 * u - 0.5), math.floor(2.0 * v - 0.5)


@lru_cache(maxsize=4)
def tube_maps(effect: MirrorHolder, camera: OmniCamera) -> tuple[Floats, Floats]:
    """Factors of a pixel's own light and of the opposite one's, (h, w)."""
    radius_m, inverse_height = _holder_size(effect, camera)
    mirror_r, mirror_z = camera.mirror.surface_point(np.linspace(0.0, camera.rim_t, _NUM_POINTS))
    # At x = -r and r a ghost's ray has the height (2 D - x) cot(theta).
    highest = max(float((mirror_z / (2.0 * radius_m + x)).max()) for x in (mirror_r, -mirror_r))
    normal = effect._normal_transmittance

    def factors(radius_px: Floats) -> Floats:
        sine, cosine = _sine_cosine(camera, radius_px)
        direct, ghost = effect._slab(sine)
        passes = radius_m * inverse_height * cosine < sine
        is_free = (cosine > highest * sine) & (3.0 * radius_m * inverse_height * cosine < sine)
        is_shown = radius_px <= camera.rim_radius_px
        return np.stack(
            (
                np.where(passes, direct / normal, 1.0),
                np.where(is_free & is_shown, ghost, 0) / normal,
            ),
            axis=-1,
        )

    maps = map_of_radius(camera, factors)
    columns, rows = (
        last - np.arange(count)
        for last, count in zip(opposite_sums(camera), maps.shape[1::-1], strict=True)
    )
    # Beyond the image's edge nothing is seen that could be a ghost.
    is_seen = (columns >= 0) & (columns < camera.width_px)
    is_seen = is_seen & ((rows >= 0) & (rows < camera.height_px))[:, None]
    direct, ghost = maps[..., 0].copy(), np.where(is_seen, maps[..., 1], 0.0)
    for one in (direct, ghost):
        one.setflags(write=False)
    return direct, ghost


@lru_cache(maxsize=4)
def strut_coverage(effect: MirrorHolder, camera: OmniCamera) -> Floats:
    """Fraction of each pixel's view that struts cover, (h, w)."""
    distance_m, inverse_height = _holder_size(effect, camera)
    half_rad = arcsin(np.array(min(1.0, 0.5 * effect.strut_width_m / distance_m)))
    positions = pixel_sample_positions(camera)[:, :, 0]
    direction, is_shown = camera.direction_from_pixel(positions)
    offset = positions - camera.centre_px
    radius_px = hypot(offset[..., 0], offset[..., 1])
    azimuth_rad = arctan2(direction[..., 1], direction[..., 0]) - effect.azimuth_rad
    # From the nearest of all struts, along the circle around the axis.
    spacing_rad = 2.0 * math.pi / effect.num_struts
    aside_px = radius_px * (azimuth_rad - spacing_rad * np.rint(azimuth_rad / spacing_rad))
    half_px = radius_px * half_rad
    ends = np.minimum(half_px, aside_px + 0.5) - np.maximum(-half_px, aside_px - 0.5)
    sine, cosine = _sine_cosine(camera, radius_px)
    is_held = is_shown & (distance_m * inverse_height * cosine < sine)
    sharp = np.where(is_held, np.clip(ends, 0.0, 1.0), 0.0)

    def range_m(radii_px: Floats) -> Floats:
        # Where the holder ends towards the camera, its highest point.
        least = distance_m * inverse_height / hypot(1.0, distance_m * inverse_height)
        return distance_m / np.maximum(_sine_cosine(camera, radii_px)[0], max(least, 1e-3))

    soft = make_near_blur(effect.aperture, camera, range_m).blur(sharp)
    coverage = np.where(is_shown, np.clip(soft, 0.0, 1.0), 0.0)
    coverage.setflags(write=False)
    return coverage


def _holder_size(effect: MirrorHolder, camera: OmniCamera) -> tuple[float, float]:
    """Distance from the axis, and 1 over the height of the pinhole, 0 of a telecentric lens."""
    rim_m = float(camera.mirror.surface_point(np.array(camera.rim_t))[0])
    return max(effect.distance_m, rim_m), 1.0 / camera.mirror.pinhole_distance_m


def _sine_cosine(camera: OmniCamera, radius_px: Floats) -> tuple[Floats, Floats]:
    """Of theta at image radii, at most the rim's."""
    t = camera.t_from_radius_px(np.minimum(radius_px, camera.rim_radius_px))
    whole = 1.0 + np.square(t)
    return 2.0 * t / whole, (1.0 - t) * (1.0 + t) / whole


def _create_effect(
    num_struts: float,
    distance_m: float,
    refractive_index: float,
    strut_width_m: float,
    azimuth_rad: float,
    albedo: float,
    f_number: float,
    pixel_pitch_m: float,
    focus_distance_m: float,
) -> MirrorHolder:
    aperture = Aperture(f_number, pixel_pitch_m, focus_distance_m)
    size = (distance_m, refractive_index, strut_width_m, azimuth_rad, albedo)
    return MirrorHolder(int(num_struts), *size, aperture)


EFFECT_TYPE = EffectType(
    "MirrorHolder",
    _create_effect,
    (
        EffectParameter("HolderStruts", "num_struts", 0.0, 0.0, 12.0),
        EffectParameter("HolderDistance", "distance_m", 0.05, 1e-3, 1.0),
        # Acrylic glass.
        EffectParameter("HolderIndex", "refractive_index", 1.49, 1.0, 3.0),
        EffectParameter("HolderStrutWidth", "strut_width_m", 0.004, 1e-4, 0.1),
        EffectParameter("HolderAzimuth", "azimuth_rad", 0.0, -math.pi, math.pi),
        EffectParameter("HolderAlbedo", "albedo", 0.1, 0.0, 1.0),
        *APERTURE_PARAMETERS,
    ),
    needs_mirror=True,
    needs_viewpoint=True,
)
