"""Which plans are possible: every number of a plan, in steps worth having.

Polygons are never offered instead of the exact mirror: they cost more and show less. Where a robot
has polygons, they are kept: they are what its mirror is.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.render_plan import (
    DEFAULT_STRIDE_PX,
    RendererKind,
    RenderPlan,
    plan_from_settings,
)
from catoptra_server.robot.render_settings import MirrorSurface, PerPixel, RenderSettings

SAMPLE_COUNTS = tuple(range(1, 9))
# Below half a texel a pixel a face is a smear; above four the atlas costs more than it shows.
TEXELS_PER_PX = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0)
FACE_SAMPLE_COUNTS = (1, 4)
# Trace keeps some 100 bytes for each: 8 x 8 samples of 720 x 720 px. Preparing them takes seconds.
MAX_SAMPLES = 2**25


def generate_candidate_plans(
    surface: MirrorSurface, camera: OmniCamera, kinds: Iterable[RendererKind]
) -> Iterator[RenderPlan]:
    """Iterate over the plans by which these renderers can draw a camera's mirror."""
    for kind in kinds:
        for variant in _settings_variants(surface, kind):
            plan = plan_from_settings(variant, camera, kind=kind, reason="possible")
            for samples in _sample_counts(camera):
                yield replace(plan, samples=samples)


def _sample_counts(camera: OmniCamera) -> tuple[int, ...]:
    pixels = camera.width_px * camera.height_px
    return tuple(s for s in SAMPLE_COUNTS if s == 1 or pixels * s * s <= MAX_SAMPLES)


def _settings_variants(surface: MirrorSurface, kind: RendererKind) -> Iterator[RenderSettings]:
    """Iterate over all numbers but the samples."""
    wish = RenderSettings(surface)
    if kind is RendererKind.TRACE:
        strides = (1, DEFAULT_STRIDE_PX) if isinstance(surface, PerPixel) else (1,)
        yield from (replace(wish, stride_px=stride_px) for stride_px in strides)
        return
    for texels_per_px in TEXELS_PER_PX:
        for samples in FACE_SAMPLE_COUNTS:
            yield replace(wish, texels_per_px=texels_per_px, face_samples=samples)
