"""Which plans are possible: every number that a wish leaves open, in steps worth having.

Polygons are never offered instead of the exact mirror: they cost more and show less. What a wish
says in numbers is kept.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.plan.render_plan import (
    DEFAULT_STRIDE_PX,
    RendererKind,
    RenderPlan,
    plan_from_wish,
)
from catoptra_server.robot.render_wish import PerPixel, RenderWish

SAMPLES = tuple(range(1, 9))
# Below half a texel a pixel a face is a smear; above four the atlas costs more than it shows.
TEXELS_PER_PX = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0)
FACE_SAMPLES = (1, 4)
# Trace keeps some 100 bytes for each: 8 x 8 samples of 720 x 720 px. Preparing them takes seconds.
MOST_SAMPLES = 2**25


def candidates(
    wish: RenderWish, camera: OmniCamera, kinds: Iterable[RendererKind]
) -> Iterator[RenderPlan]:
    """Iterate over the plans by which these renderers can draw a camera as wished."""
    for kind in kinds:
        for variant in _variants(wish, kind):
            plan = plan_from_wish(variant, camera, kind=kind, why="possible")
            for samples in _samples(wish, camera):
                yield replace(plan, samples=samples)


def _samples(wish: RenderWish, camera: OmniCamera) -> tuple[int, ...]:
    if wish.samples:
        return (wish.samples,)
    pixels = camera.width_px * camera.height_px
    return tuple(s for s in SAMPLES if s == 1 or pixels * s * s <= MOST_SAMPLES)


def _variants(wish: RenderWish, kind: RendererKind) -> Iterator[RenderWish]:
    """Iterate over the wish with all but the samples filled in."""
    if kind is RendererKind.TRACE:
        is_exact = isinstance(wish.surface, PerPixel)
        open_strides = (1, DEFAULT_STRIDE_PX) if is_exact else (1,)
        for stride_px in (wish.stride_px,) if wish.stride_px else open_strides:
            yield replace(wish, stride_px=stride_px)
        return
    sizes = (wish.texels_per_px,) if wish.face_size_px or wish.texels_per_px else TEXELS_PER_PX
    for texels_per_px in sizes:
        for samples in (wish.face_samples,) if wish.face_samples else FACE_SAMPLES:
            yield replace(wish, texels_per_px=texels_per_px, face_samples=samples)
