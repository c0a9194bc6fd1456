"""Plans from explicit numbers, with defaults for the rest."""

from __future__ import annotations

import math

import pytest

from catoptra_protocol.optics.cube_map import MAX_FIVE_FACE_RIM_RAD, Face
from catoptra_server.frames.plan.faces import max_face_size_px
from catoptra_server.frames.plan.plans import (
    DEFAULT_FACE_SAMPLES,
    DEFAULT_SAMPLES,
    max_incidence_rad,
    plan_from_settings,
)
from catoptra_server.render.render_settings import PerPixel, RenderSettings
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Tessellation
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=360)


def make_plan(
    settings: RenderSettings, *, rim_deg: float = 120.0, width_px: int = 360
) -> RenderPlan:
    camera = make_omni_camera(width_px=width_px, rim_deg=rim_deg)
    return plan_from_settings(settings, camera, kind=RendererKind.RASTER, reason="requested")


def test_plan_by_default_has_a_texel_a_pixel() -> None:
    plan = make_plan(RenderSettings())
    assert (plan.samples, plan.face_samples) == (DEFAULT_SAMPLES, DEFAULT_FACE_SAMPLES)
    # Square texels would need 1.01 image widths; texels of two densities a little less.
    assert plan.face_size_px == 360
    assert plan.face_size_px == max_face_size_px(plan.face_regions)
    assert plan.faces == (Face.N, Face.E, Face.S, Face.W, Face.C)


def test_plan_takes_explicit_numbers() -> None:
    plan = make_plan(
        RenderSettings(Tessellation(8, 8), samples=3, face_size_px=100, face_samples=4)
    )
    assert (plan.samples, plan.face_size_px, plan.face_samples) == (3, 100, 4)
    assert plan.surface == Tessellation(8, 8)
    assert {(part.columns_per_unit, part.rows_per_unit) for part in plan.face_regions} == {(50, 50)}


@pytest.mark.parametrize(("rim_deg", "faces"), [(120.0, 5), (125.26, 5), (125.27, 6), (150.0, 6)])
def test_plan_when_the_rim_looks_above_125_deg_has_a_sixth_face(rim_deg: float, faces: int) -> None:
    assert len(make_plan(RenderSettings(), rim_deg=rim_deg).faces) == faces


def test_incidence_of_an_exact_mirror_ends_at_the_rim() -> None:
    assert max_incidence_rad(CAMERA, PerPixel()) == CAMERA.rim_rad


def test_incidence_of_a_coarse_mesh_is_higher_than_the_rim() -> None:
    four, many = (max_incidence_rad(CAMERA, Tessellation(s, s)) for s in (4, 4096))
    # 90 deg + atan(tan 30 deg / cos 45 deg)
    assert math.degrees(four) == pytest.approx(129.23, abs=0.01)
    assert CAMERA.rim_rad < many < CAMERA.rim_rad + 1e-6
    assert four > MAX_FIVE_FACE_RIM_RAD


def test_incidence_when_the_rim_is_below_the_horizon_is_the_rim() -> None:
    camera = make_omni_camera(rim_deg=80.0)
    assert max_incidence_rad(camera, Tessellation(4, 4)) == camera.rim_rad
