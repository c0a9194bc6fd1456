"""The steps of the study: ways to draw one and the same frame, from coarse and cheap to exact.

The polygon splits are those of the paper, as many sectors as rings, and those that are cut four
times finer around than outwards. To add a step, add its line here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from catoptra_server.render.render_plan import PerPixel, RendererKind, RenderSettings
from catoptra_server.scene.mirror_mesh import Interpolation, Tessellation

SQUARE_TESSELLATIONS = ((4, 4), (8, 8), (16, 16), (32, 32), (64, 64))
WIDE_TESSELLATIONS = ((8, 2), (16, 4), (32, 8), (64, 16), (128, 32))
POLYGON_COUNTS = tuple(sectors * rings for sectors, rings in SQUARE_TESSELLATIONS)
# Of the plan's own face size, which has a texel a pixel.
FACE_SCALES = (0.5, 1.0, 2.0)
SAMPLES = (1, 2, 3, 4)


@dataclass(frozen=True, slots=True)
class AccuracyLevel:
    """One way to draw a frame. is_key: whether landmarks and localisation are measured, too."""

    name: str
    renderer_kind: RendererKind
    render_settings: RenderSettings
    is_key: bool = False


def accuracy_sweep(face_size_px: int) -> tuple[AccuracyLevel, ...]:
    """Return all steps; `face_size_px` is the face that the plan itself would take."""
    return (
        *_trace_levels(SAMPLES),
        *_per_pixel_levels(face_size_px, FACE_SCALES, SAMPLES),
        _supersampled_faces_level(),
        *_polygon_levels((SQUARE_TESSELLATIONS, WIDE_TESSELLATIONS), tuple(Interpolation), (1, 2)),
    )


def quick_accuracy_sweep(face_size_px: int) -> tuple[AccuracyLevel, ...]:
    """Return the steps of a quick look: the key ones, and what lies around them."""
    return (
        *_trace_levels((1, 2, 4)),
        *_per_pixel_levels(face_size_px, (1.0,), (1, 2)),
        *_polygon_levels((SQUARE_TESSELLATIONS,), (Interpolation.UV,), (2,)),
    )


def _trace_levels(samples: Sequence[int]) -> Iterator[AccuracyLevel]:
    for number in samples:
        wish = RenderSettings(PerPixel(), number)
        name = f"trace per pixel, {number}x{number}"
        yield AccuracyLevel(name, RendererKind.TRACE, wish, is_key=number == 4)


def _per_pixel_levels(
    face_size_px: int, scales: Sequence[float], samples: Sequence[int]
) -> Iterator[AccuracyLevel]:
    for scale in scales:
        for number in samples:
            size = 0 if scale == 1.0 else round(scale * face_size_px)
            faces = "" if scale == 1.0 else f", faces x {scale:g}"
            wish = RenderSettings(PerPixel(), number, size)
            name = f"raster per pixel, {number}x{number}{faces}"
            yield AccuracyLevel(
                name, RendererKind.RASTER, wish, is_key=scale == 1.0 and number in (1, 2)
            )


def _supersampled_faces_level() -> AccuracyLevel:
    """Return the step whose faces have four samples a texel of their own."""
    wish = RenderSettings(PerPixel(), 2, face_samples=4)
    return AccuracyLevel("raster per pixel, 2x2, faces of 4 samples", RendererKind.RASTER, wish)


def _polygon_levels(
    tessellations: Sequence[Sequence[tuple[int, int]]],
    interpolations: Sequence[Interpolation],
    samples: Sequence[int],
) -> Iterator[AccuracyLevel]:
    for sectors, rings in (split for row in tessellations for split in row):
        for way in interpolations:
            for number in samples:
                split = Tessellation(sectors, rings, way)
                # The paper's own meshes at the samples that a frame has where nothing is asked.
                is_key = sectors == rings and way is Interpolation.UV and number == 2
                yield AccuracyLevel(_polygon_level_name(split, number), RendererKind.RASTER,
                           RenderSettings(split, number), is_key)  # fmt: skip


def _polygon_level_name(tessellation: Tessellation, samples: int) -> str:
    shape = (
        ""
        if tessellation.sectors == tessellation.rings
        else f" as {tessellation.sectors}x{tessellation.rings}"
    )
    return f"{tessellation.num_polygons} polygons{shape} ({tessellation.interpolation.value}), {samples}x{samples}"


def level_robot_ini(level: AccuracyLevel, size_px: int) -> str:
    """Return the lines of a robot file, based on another, that ask for this step."""
    wish = level.render_settings
    faces = f"[USARBot.USARCameraTextureClientN]\nTextureSize={wish.face_size_px}\n"
    return (
        f"[Catoptra.HyperbolicMirror]\n{_surface_ini(wish)}"
        f"[Catoptra.OmniCaptureCamera]\nResolutionX={size_px}\nResolutionY={size_px}\n"
        f"Samples={wish.samples}\nFaceSamples={wish.face_samples}\n{faces}"
    )


def _surface_ini(settings: RenderSettings) -> str:
    match settings.surface:
        case PerPixel():
            return "Polygons=0\n"
        case Tessellation(sectors, rings, way):
            return f"Sectors={sectors}\nRings={rings}\nInterpolation={way.value}\n"
