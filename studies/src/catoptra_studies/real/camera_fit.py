"""Parameters of a real camera that photographs of boards allow: focus, aperture, noise, colour.

* Blur. Widths of edges by incidence, less those of a twin without blur, are discs of defocus: a
  disc of diameter d has the deviation d / 4 along a line. The lens below the mirror has an f-number
  and a focus; the mirror's shape follows from the image radii and from the focal length of the
  lens, the third number. The size of the mirror and the pitch of pixels are taken as given: each
  scales the f-number alone.
* Noise. Patches of white and of black squares give two numbers, the full well and the read noise.
  Coding takes noise away and adds its own, so both are found by drawing, coding and measuring
  twins, and scaling the variances until they agree.
* Lateral colour: corners found again in red and in blue.

What cannot be told apart: diffraction and a demosaicing filter are blur that does not depend on the
incidence, and are in the f-number here; the lens's shading is not separated from the gradient of
the room's light; exposure, glare and black level are one level of black.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.kernels.lens_blur import Aperture, circle_of_confusion
from catoptra_studies.real.picture_measures import PictureMeasures, linear_light

PIXEL_PITCH_M = 7.4e-6
VERTEX_M = 0.1
"""Assumed: they scale the f-number alone."""
FOCAL_LENGTHS_PX = (400.0, 600.0, 800.0, 1200.0, 2000.0)
_SIGMA_PER_WIDTH = 1.0 / 2.5631
_BINS_DEG = np.arange(50.0, 121.0, 7.0)
_MIN_EDGES = 12
# Depths from the pinhole at which the lens may be sharp, over the viewpoint's.
_NUM_FOCI, _FOCUS_REACH = 60, (0.7, 6.0)
_F_NUMBERS = (0.7, 64.0)


@dataclass(frozen=True, slots=True)
class CameraParameters:
    """Parameters of effects, fitted or assumed."""

    focal_px: float = 800.0
    f_number: float = 4.0
    focus_m: float = 0.0
    full_well_e: float = 3000.0
    read_noise_e: float = 2.0
    red: float = 1.0
    blue: float = 1.0
    mean_light: float = 0.18
    """Of the photographs, for automatic exposure."""
    jpeg_quality: int | None = None

    def lens_lines(self) -> tuple[str, ...]:
        """Lines of the lens that effects share."""
        return (
            f"FNumber={self.f_number:.3f}",
            f"PixelPitch={PIXEL_PITCH_M}",
            f"FocusDistance={self.focus_m:.5f}",
        )

    def noise_lines(self) -> tuple[str, ...]:
        """Lines of the sensor's noise."""
        return (
            f"FullWell={self.full_well_e:.1f}",
            f"ReadNoiseElectrons={self.read_noise_e:.3f}",
        )


@dataclass(frozen=True, slots=True, eq=False)
class BlurProfile:
    """Mean squares of edges' deviations by incidence, px^2, in bins with enough edges."""

    incidence_rad: Floats
    variance_px2: Floats


def measure_blur(measures: Sequence[PictureMeasures]) -> BlurProfile:
    """Blur by incidence of pictures together."""
    angle = np.concatenate([one.edge_incidence_rad for one in measures])
    variance = np.square(
        _SIGMA_PER_WIDTH * np.concatenate([one.edge_widths_px for one in measures])
    )
    number = np.digitize(np.degrees(angle), _BINS_DEG)
    kept = [n for n in range(1, len(_BINS_DEG)) if (number == n).sum() >= _MIN_EDGES]
    return BlurProfile(
        np.array([angle[number == n].mean() for n in kept]),
        # Medians: an edge beside a hand is no edge of the board.
        np.array([np.median(variance[number == n]) for n in kept]),
    )


def fit_blur(
    start: CameraParameters,
    cameras: Mapping[float, OmniCamera],
    photographs: BlurProfile,
    base: BlurProfile,
    range_m: float,
) -> tuple[CameraParameters, dict[float, float]]:
    """F-number, focus and focal length whose discs make the photographs' edges of the base's.

    Args:
        start: Parameters to change.
        cameras: Mirror camera by the focal length of its capture lens.
        photographs: Blur of the photographs.
        base: Blur of twins without defocus.
        range_m: Distance of the boards.

    Returns:
        The parameters, and the rms of what is left of the widths, px, by focal length.
    """
    there = np.interp(photographs.incidence_rad, base.incidence_rad, base.variance_px2)
    excess = np.maximum(photographs.variance_px2 - there, 0.0)
    best, left_by_focal = (math.inf, start), {}
    for focal_px, camera in cameras.items():
        radius = camera.radius_px_from_t(np.tan(0.5 * photographs.incidence_rad))
        found = math.inf, 1.0, 1.0
        vertex_m = camera.mirror.pinhole_distance_m
        low, high = (reach * vertex_m for reach in _FOCUS_REACH)
        # The best of a coarse grid, then of a fine one around it.
        for _ in range(2):
            grid = np.geomspace(low, high, _NUM_FOCI)
            each = [_fit_aperture(camera, radius, range_m, excess, focus) for focus in grid]
            found = min(found, *each)
            step = grid[1] / grid[0]
            low, high = found[2] / step, found[2] * step
        total, f_number, focus_m = found
        left_by_focal[focal_px] = total
        if total < best[0]:
            best = total, replace(start, focal_px=focal_px, f_number=f_number, focus_m=focus_m)
    return best[1], left_by_focal


def _fit_aperture(
    camera: OmniCamera, radius_px: Floats, range_m: float, excess: Floats, focus_m: float
) -> tuple[float, float, float]:
    """Rms left of the deviations, px, and the best f-number of one focus."""
    aperture = Aperture(1.0, PIXEL_PITCH_M, float(focus_m))
    discs = circle_of_confusion(aperture, camera, radius_px).diameter_px(np.array(range_m))
    variance = np.square(discs) / 16.0
    scale = float(variance @ excess) / max(float(variance @ variance), 1e-12)
    f_number = float(np.clip(1.0 / math.sqrt(max(scale, 1e-9)), *_F_NUMBERS))
    model = variance / (f_number * f_number)
    left = np.sqrt(model) - np.sqrt(excess)
    return math.sqrt(float(left @ left) / len(left)), f_number, float(focus_m)


def refine_aperture(
    start: CameraParameters, photographs: BlurProfile, drawn: BlurProfile, base: BlurProfile
) -> CameraParameters:
    """F-number scaled so that what defocus adds to the drawn edges is what photographs have."""

    def excess(one: BlurProfile) -> float:
        there = np.interp(one.incidence_rad, base.incidence_rad, base.variance_px2)
        return float(np.maximum(one.variance_px2 - there, 1e-4).mean())

    factor = math.sqrt(excess(drawn) / excess(photographs))
    return replace(start, f_number=float(np.clip(start.f_number * factor, *_F_NUMBERS)))


def refine_noise(
    start: CameraParameters,
    photographs: Sequence[PictureMeasures],
    drawn: Sequence[PictureMeasures],
) -> CameraParameters:
    """Full well and read noise scaled so that patches of both colours have their noise.

    Variance of light is s L + q: s of shot noise, q of read noise.
    """
    light, factor = [], []
    for is_white in (True, False):
        levels = [one.patch_levels[one.patch_is_white == is_white] for one in photographs]
        light.append(float(np.median(linear_light(np.concatenate(levels)))))
        each = [_mean_noise(group, is_white) for group in (photographs, drawn)]
        factor.append((each[0] / max(each[1], 0.05)) ** 2)
    s = 1.0 / start.full_well_e
    q = (start.read_noise_e / start.full_well_e) ** 2
    # A step changes a variance ninefold at most.
    wanted = [np.clip(f, 1 / 9, 9.0) * (s * at + q) for f, at in zip(factor, light, strict=True)]
    s = max((wanted[0] - wanted[1]) / max(light[0] - light[1], 1e-6), 1e-9)
    q = max(wanted[1] - s * light[1], 0.0)
    if q == 0.0:
        s = wanted[0] / light[0]
    return replace(start, full_well_e=1.0 / s, read_noise_e=math.sqrt(q) / s)


def _mean_noise(measures: Sequence[PictureMeasures], is_white: bool) -> float:
    return float(np.nanmean([one.noise(is_white) for one in measures]))


def describe_camera(
    parameters: CameraParameters, left_by_focal: Mapping[float, float], count: int
) -> tuple[str, ...]:
    """Lines of effects of the fitted camera's file, each number with its source."""
    p = parameters
    ties = ", ".join(f"{f:.0f}: {left:.3f}" for f, left in left_by_focal.items())
    lines = (
        ("DefocusByDepth=always", ""),
        ("Defocus=always", ""),
        (f"FNumber={p.f_number:.3f}", "fitted to edges; diffraction and demosaicing are in it"),
        (f"PixelPitch={PIXEL_PITCH_M}", "assumed: scales FNumber alone, as VertexDistance does"),
        (f"FocusDistance={p.focus_m:.5f}", "fitted to edges by incidence: m from the pinhole"),
        ("ChromaticAberration=always", ""),
        (f"RedMagnification={p.red:.6f}", "corners in red over those in green"),
        (f"BlueMagnification={p.blue:.6f}", "corners in blue over those in green"),
        ("Vignetting=always", "by the focal length; not told apart from the room's light"),
        ("ShotNoise=always", ""),
        (f"FullWell={p.full_well_e:.1f}", "fitted to white patches, through the coding"),
        ("ReadNoise=always", ""),
        (f"ReadNoiseElectrons={p.read_noise_e:.3f}", "fitted to black patches, likewise"),
    )
    return (
        f"; {count} photographs. Rms left of edges' deviations, px, by focal length, px: {ties}",
        *(f"{line:<28}; {source}" if source else line for line, source in lines),
    )


Draw = Callable[[CameraParameters], Sequence[PictureMeasures]]
"""Measures of the same photographs' twins, drawn and coded with parameters."""


def fit_camera(
    start: CameraParameters,
    cameras: Mapping[float, OmniCamera],
    photographs: Sequence[PictureMeasures],
    *,
    base: Sequence[PictureMeasures],
    draw: Draw,
    range_m: float,
    num_rounds: int = 2,
) -> tuple[CameraParameters, dict[float, float]]:
    """Parameters of a camera: blur in closed form, then both scales by drawing.

    Args:
        start: Parameters to begin with.
        cameras: Mirror camera by focal length.
        photographs: Measures of photographs.
        base: Measures of their twins without blur, coded.
        draw: Draws twins.
        range_m: Distance of the boards.
        num_rounds: Rounds of drawing.

    Returns:
        The parameters, and the rms left of edges by focal length.
    """
    blur, clean = measure_blur(photographs), measure_blur(base)
    fitted, left = fit_blur(start, cameras, blur, clean, range_m)
    for _ in range(num_rounds):
        drawn = draw(fitted)
        fitted = refine_aperture(fitted, blur, measure_blur(drawn), clean)
        fitted = refine_noise(fitted, photographs, drawn)
    return fitted, left
