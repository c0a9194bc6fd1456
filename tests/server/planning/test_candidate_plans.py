"""What is possible: every renderer, sample and texel; of surfaces only the one that is there."""

from __future__ import annotations

from catoptra_server.planning.candidate_plans import (
    FACE_SAMPLE_COUNTS,
    SAMPLE_COUNTS,
    TEXELS_PER_PX,
    generate_candidate_plans,
)
from catoptra_server.render.render_plan import MirrorSurface, PerPixel, RendererKind, RenderPlan
from catoptra_server.scene.mirror_mesh import Tessellation
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=64)
TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER


def candidate_plans(
    surface: MirrorSurface, *kinds: RendererKind, width_px: int = 64
) -> list[RenderPlan]:
    return list(generate_candidate_plans(surface, make_omni_camera(width_px=width_px), kinds))


def test_candidates_when_all_is_open_are_all_steps_of_both_renderers() -> None:
    assert len(candidate_plans(PerPixel(), TRACE)) == 2 * len(SAMPLE_COUNTS)
    count = len(SAMPLE_COUNTS) * len(TEXELS_PER_PX) * len(FACE_SAMPLE_COUNTS)
    assert len(candidate_plans(PerPixel(), RASTER)) == count
    assert len(candidate_plans(PerPixel(), TRACE, RASTER)) == 2 * len(SAMPLE_COUNTS) + count


def test_candidates_when_nobody_asks_for_polygons_have_none() -> None:
    assert {plan.surface for plan in candidate_plans(PerPixel(), TRACE, RASTER)} == {PerPixel()}


def test_candidates_when_polygons_are_asked_for_have_these_and_every_ray() -> None:
    split = Tessellation(16, 16)
    found = candidate_plans(split, TRACE)
    assert {(plan.surface, plan.stride_px) for plan in found} == {(split, 1)}


def test_candidates_of_a_large_picture_stay_within_memory_but_for_one_sample() -> None:
    assert {plan.samples for plan in candidate_plans(PerPixel(), TRACE, width_px=2048)} == {1, 2}
    assert {plan.samples for plan in candidate_plans(PerPixel(), TRACE, width_px=8192)} == {1}
