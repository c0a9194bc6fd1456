"""Accuracy levels: ways to render the same frame, from coarse and cheap to exact.

The paper's tessellations have as many sectors as rings; others are divided four times finer around
the axis than along the radius. A new level is one line of `accuracy_sweep`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

from catoptra_server.render.renderer import PerPixel, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation

# (sectors, rings); the products of the square ones are POLYGON_COUNTS of paper_values.
SQUARE_TESSELLATIONS = ((4, 4), (8, 8), (16, 16), (32, 32), (64, 64))
WIDE_TESSELLATIONS = ((8, 2), (16, 4), (32, 8), (64, 16), (128, 32))
# Factors on the plan's own face size, which has one texel a pixel.
_FACE_SCALES = (0.5, 1.0, 2.0)
# Samples along a pixel's side.
_SAMPLES = (1, 2, 3, 4)


@dataclass(frozen=True, slots=True)
class AccuracyLevel:
    """One way to render a frame."""

    name: str
    renderer_kind: RendererKind
    render_settings: RenderSettings

    is_key: bool = False
    """Whether robots are driven with frames of this level to measure detection and localization."""


def accuracy_sweep(face_size_px: int) -> tuple[AccuracyLevel, ...]:
    """All levels, for a camera with faces of `face_size_px` in the plan."""
    return (
        *_trace_levels(_SAMPLES),
        *_per_pixel_levels(face_size_px, _FACE_SCALES, _SAMPLES),
        # Faces with four samples a texel: whether samples are better spent on faces or on pixels.
        AccuracyLevel(
            "raster per pixel, 2x2, faces of 4 samples",
            RendererKind.RASTER,
            RenderSettings(PerPixel(), 2, face_samples=4),
        ),
        *_polygon_levels(
            (*SQUARE_TESSELLATIONS, *WIDE_TESSELLATIONS), tuple(Interpolation), (1, 2)
        ),
    )


def quick_accuracy_sweep(face_size_px: int) -> tuple[AccuracyLevel, ...]:
    """The key levels and their neighbours, measured within a minute."""
    return (
        *_trace_levels((1, 2, 4)),
        *_per_pixel_levels(face_size_px, (1.0,), (1, 2)),
        # The paper's own meshes, which are all key levels.
        *_polygon_levels(SQUARE_TESSELLATIONS, (Interpolation.UV,), (2,)),
    )


def _trace_levels(samples: Sequence[int]) -> Iterator[AccuracyLevel]:
    for number in samples:
        settings = RenderSettings(PerPixel(), number)
        name = f"trace per pixel, {number}x{number}"
        # 4 x 4 exact rays are the best frame of the sweep, on which the classifier is trained.
        yield AccuracyLevel(name, RendererKind.TRACE, settings, is_key=number == 4)


def _per_pixel_levels(
    face_size_px: int, scales: Sequence[float], samples: Sequence[int]
) -> Iterator[AccuracyLevel]:
    for scale, number in product(scales, samples):
        # Size 0 gives each face the texels that the face's densest pixel needs; a number gives
        # all faces the same. Scale 1 is to be the frame that a robot renders by default.
        size_px = 0 if scale == 1.0 else round(scale * face_size_px)
        suffix = "" if scale == 1.0 else f", faces x {scale:g}"
        yield AccuracyLevel(
            f"raster per pixel, {number}x{number}{suffix}",
            RendererKind.RASTER,
            RenderSettings(PerPixel(), number, size_px),
            is_key=scale == 1.0 and number in (1, 2),
        )


def _polygon_levels(
    tessellations: Sequence[tuple[int, int]],
    interpolations: Sequence[Interpolation],
    samples: Sequence[int],
) -> Iterator[AccuracyLevel]:
    for (sectors, rings), interpolation, number in product(tessellations, interpolations, samples):
        tessellation = Tessellation(sectors, rings, interpolation)
        shape = "" if sectors == rings else f" as {sectors}x{rings}"
        yield AccuracyLevel(
            f"{tessellation.num_polygons} polygons{shape} ({interpolation.value}), "
            f"{number}x{number}",
            RendererKind.RASTER,
            RenderSettings(tessellation, number),
            # The paper's own meshes, with the samples of a frame by default.
            is_key=sectors == rings and interpolation is Interpolation.UV and number == 2,
        )


def level_robot_ini(level: AccuracyLevel, size_px: int) -> str:
    """Sections of a robot file that select a level, to follow a `BasedOn` line.

    Args:
        level: The level to select.
        size_px: Width and height of the image.
    """
    settings = level.render_settings
    match settings.surface:
        case PerPixel():
            surface = "Polygons=0\n"
        case Tessellation(sectors, rings, interpolation):
            surface = f"Sectors={sectors}\nRings={rings}\nInterpolation={interpolation.value}\n"
    numbers = {"Samples": settings.samples, "FaceSamples": settings.face_samples}
    # 0 is the default's number, which a file states by leaving the key out.
    stated = "".join(f"{key}={number}\n" for key, number in numbers.items() if number)
    return (
        f"[Catoptra.HyperbolicMirror]\n{surface}"
        f"[Catoptra.OmniCaptureCamera]\nResolutionX={size_px}\nResolutionY={size_px}\n{stated}"
        f"[USARBot.USARCameraTextureClientN]\nTextureSize={settings.face_size_px}\n"
    )
