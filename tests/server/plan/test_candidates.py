"""What is possible: every renderer, sample and texel; of surfaces only the one that is there."""

from __future__ import annotations

from catoptra_server.plan.candidates import FACE_SAMPLES, SAMPLES, TEXELS_PER_PX, candidates
from catoptra_server.plan.render_plan import PerPixel, RendererKind, RenderPlan, Surface
from catoptra_server.scene.mirror_mesh import PolygonSplit
from helpers.worlds import omni_camera

CAMERA = omni_camera(width_px=64)
TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER


def plans(surface: Surface, *kinds: RendererKind, width_px: int = 64) -> list[RenderPlan]:
    return list(candidates(surface, omni_camera(width_px=width_px), kinds))


def test_candidates_when_all_is_open_are_all_steps_of_both_renderers() -> None:
    assert len(plans(PerPixel(), TRACE)) == 2 * len(SAMPLES)
    count = len(SAMPLES) * len(TEXELS_PER_PX) * len(FACE_SAMPLES)
    assert len(plans(PerPixel(), RASTER)) == count
    assert len(plans(PerPixel(), TRACE, RASTER)) == 2 * len(SAMPLES) + count


def test_candidates_when_nobody_asks_for_polygons_have_none() -> None:
    assert {plan.surface for plan in plans(PerPixel(), TRACE, RASTER)} == {PerPixel()}


def test_candidates_when_polygons_are_asked_for_have_these_and_every_ray() -> None:
    split = PolygonSplit(16, 16)
    found = plans(split, TRACE)
    assert {(plan.surface, plan.stride_px) for plan in found} == {(split, 1)}


def test_candidates_of_a_large_picture_stay_within_memory_but_for_one_sample() -> None:
    assert {plan.samples for plan in plans(PerPixel(), TRACE, width_px=2048)} == {1, 2}
    assert {plan.samples for plan in plans(PerPixel(), TRACE, width_px=8192)} == {1}
