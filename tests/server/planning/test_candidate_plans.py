"""Candidates: every renderer, sample count and texel density, one surface."""

from __future__ import annotations

import pytest

from catoptra_server.frames.plan.candidates import (
    FACE_SAMPLE_COUNTS,
    SAMPLE_COUNTS,
    TEXELS_PER_PX,
    generate_calibration_plans,
    generate_candidate_plans,
)
from catoptra_server.frames.plan.costs import cost_group
from catoptra_server.frames.plan.plans import plan_view_size
from catoptra_server.render.render_settings import MirrorSurface, PerPixel
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES
from catoptra_server.world.mirror_mesh import Tessellation
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=64)
TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER


def candidate_plans(
    surface: MirrorSurface, *kinds: RendererKind, width_px: int = 64
) -> list[RenderPlan]:
    return list(generate_candidate_plans(surface, make_omni_camera(width_px=width_px), kinds))


def test_candidates_of_both_renderers_are_all_combinations() -> None:
    assert len(candidate_plans(PerPixel(), TRACE)) == len(SAMPLE_COUNTS)
    count = len(SAMPLE_COUNTS) * len(TEXELS_PER_PX) * len(FACE_SAMPLE_COUNTS)
    assert len(candidate_plans(PerPixel(), RASTER)) == count
    assert len(candidate_plans(PerPixel(), TRACE, RASTER)) == len(SAMPLE_COUNTS) + count


def test_candidates_of_an_exact_mirror_have_no_mesh() -> None:
    assert {plan.surface for plan in candidate_plans(PerPixel(), TRACE, RASTER)} == {PerPixel()}


def test_candidates_of_a_mesh_keep_the_mesh() -> None:
    mesh = Tessellation(16, 16)
    assert {plan.surface for plan in candidate_plans(mesh, TRACE)} == {mesh}


def test_candidates_of_a_large_image_stay_within_memory_but_for_one_sample() -> None:
    assert {plan.samples for plan in candidate_plans(PerPixel(), TRACE, width_px=2048)} == {1, 2}
    assert {plan.samples for plan in candidate_plans(PerPixel(), TRACE, width_px=8192)} == {1}


def test_candidates_of_a_large_image_keep_faces_within_memory_but_for_one_sample() -> None:
    plans = candidate_plans(PerPixel(), RASTER, width_px=2048)
    camera = make_omni_camera(width_px=2048)
    large = [p for p in plans if plan_view_size(camera, p).num_bytes > DEFAULT_LIMIT_BYTES]
    # 2048 px at 4 texels a pixel would be 0.8 GB of texels, four times as much with 4 samples each.
    assert {(plan.samples, plan.face_samples) for plan in large} <= {(1, 1)}
    assert {plan.face_samples for plan in plans} == {1, 4}


@pytest.mark.parametrize("kind", RendererKind)
def test_calibration_plans_cover_every_cost_group(kind: RendererKind) -> None:
    plans = list(generate_calibration_plans(kind, CAMERA, PerPixel()))
    assert len({cost_group(plan) for plan in plans}) == 1
    assert len({plan.samples for plan in plans}) > 1


def test_calibration_plans_of_a_large_image_stay_within_memory() -> None:
    camera = make_omni_camera(width_px=2048)
    for kind in RendererKind:
        plans = list(generate_calibration_plans(kind, camera, PerPixel()))
        assert {1, 2} <= {plan.samples for plan in plans}
        large = [p for p in plans if plan_view_size(camera, p).num_bytes > DEFAULT_LIMIT_BYTES]
        assert {(plan.samples, plan.face_samples) for plan in large} <= {(1, 1)}
