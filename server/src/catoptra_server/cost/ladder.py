"""The steps of the study: ways to draw one and the same frame, from coarse and cheap to exact.

The polygon splits are those of the paper, as many sectors as rings, and those that are cut four
times finer around than outwards. To add a step, add its line here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from catoptra_server.plan.render_plan import PerPixel, RendererKind, RenderWish
from catoptra_server.scene.mirror_mesh import Interpolation, PolygonSplit

SQUARE_SPLITS = ((4, 4), (8, 8), (16, 16), (32, 32), (64, 64))
WIDE_SPLITS = ((8, 2), (16, 4), (32, 8), (64, 16), (128, 32))
COUNTS = tuple(sectors * rings for sectors, rings in SQUARE_SPLITS)
# Of the plan's own face size, which has a texel a pixel.
FACE_SCALES = (0.5, 1.0, 2.0)
SAMPLES = (1, 2, 3, 4)


@dataclass(frozen=True, slots=True)
class Step:
    """One way to draw a frame. is_key: whether landmarks and localisation are measured, too."""

    name: str
    kind: RendererKind
    wish: RenderWish
    is_key: bool = False


def ladder(face_size_px: int) -> tuple[Step, ...]:
    """Return all steps; `face_size_px` is the face that the plan itself would take."""
    return (
        *_traced(SAMPLES),
        *_per_pixel(face_size_px, FACE_SCALES, SAMPLES),
        _fine_faces(),
        *_polygons((SQUARE_SPLITS, WIDE_SPLITS), tuple(Interpolation), (1, 2)),
    )


def quick_ladder(face_size_px: int) -> tuple[Step, ...]:
    """Return the steps of a quick look: the key ones, and what lies around them."""
    return (
        *_traced((1, 2, 4)),
        *_per_pixel(face_size_px, (1.0,), (1, 2)),
        *_polygons((SQUARE_SPLITS,), (Interpolation.UV,), (2,)),
    )


def _traced(samples: Sequence[int]) -> Iterator[Step]:
    for number in samples:
        wish = RenderWish(PerPixel(), number)
        name = f"trace per pixel, {number}x{number}"
        yield Step(name, RendererKind.TRACE, wish, is_key=number == 4)


def _per_pixel(
    face_size_px: int, scales: Sequence[float], samples: Sequence[int]
) -> Iterator[Step]:
    for scale in scales:
        for number in samples:
            size = 0 if scale == 1.0 else round(scale * face_size_px)
            faces = "" if scale == 1.0 else f", faces x {scale:g}"
            wish = RenderWish(PerPixel(), number, size)
            name = f"raster per pixel, {number}x{number}{faces}"
            yield Step(name, RendererKind.RASTER, wish, is_key=scale == 1.0 and number in (1, 2))


def _fine_faces() -> Step:
    """Return the step whose faces have four samples a texel of their own."""
    wish = RenderWish(PerPixel(), 2, face_samples=4)
    return Step("raster per pixel, 2x2, faces of 4 samples", RendererKind.RASTER, wish)


def _polygons(
    splits: Sequence[Sequence[tuple[int, int]]],
    ways: Sequence[Interpolation],
    samples: Sequence[int],
) -> Iterator[Step]:
    for sectors, rings in (split for row in splits for split in row):
        for way in ways:
            for number in samples:
                split = PolygonSplit(sectors, rings, way)
                # The paper's own meshes at the samples that a frame has where nothing is asked.
                is_key = sectors == rings and way is Interpolation.UV and number == 2
                yield Step(_polygon_name(split, number), RendererKind.RASTER,
                           RenderWish(split, number), is_key)  # fmt: skip


def _polygon_name(split: PolygonSplit, samples: int) -> str:
    shape = "" if split.sectors == split.rings else f" as {split.sectors}x{split.rings}"
    return f"{split.polygons} polygons{shape} ({split.interpolation.value}), {samples}x{samples}"


def robot_lines(step: Step, size_px: int) -> str:
    """Return the lines of a robot file, based on another, that ask for this step."""
    wish = step.wish
    faces = f"[USARBot.USARCameraTextureClientN]\nTextureSize={wish.face_size_px}\n"
    return (
        f"[Catoptra.HyperbolicMirror]\n{_surface_lines(wish)}"
        f"[Catoptra.OmniCaptureCamera]\nResolutionX={size_px}\nResolutionY={size_px}\n"
        f"Samples={wish.samples}\nFaceSamples={wish.face_samples}\n{faces}"
    )


def _surface_lines(wish: RenderWish) -> str:
    match wish.surface:
        case PerPixel():
            return "Polygons=0\n"
        case PolygonSplit(sectors, rings, way):
            return f"Sectors={sectors}\nRings={rings}\nInterpolation={way.value}\n"
