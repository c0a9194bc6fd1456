"""Validity of plans, and their description."""

from __future__ import annotations

from dataclasses import replace

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.scene.mirror_mesh import Tessellation
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=360)


def make_plan(settings: RenderSettings, kind: RendererKind = RendererKind.RASTER) -> RenderPlan:
    return plan_from_settings(settings, CAMERA, kind=kind, reason="requested")


@pytest.mark.parametrize("samples", [-1, 17])
def test_plan_without_or_with_too_many_samples_is_rejected(samples: int) -> None:
    with pytest.raises(DomainError, match="1 to 16"):
        make_plan(RenderSettings(samples=samples))


@pytest.mark.parametrize("stride_px", [-1, 65])
def test_plan_with_too_distant_rays_is_rejected(stride_px: int) -> None:
    with pytest.raises(DomainError, match="1 to 64 px"):
        make_plan(RenderSettings(stride_px=stride_px))


def test_plan_of_a_mesh_with_distant_rays_is_rejected() -> None:
    with pytest.raises(DomainError, match="every ray"):
        replace(make_plan(RenderSettings(Tessellation(8, 8))), stride_px=2)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        (
            RenderSettings(samples=1),
            "raster, per pixel, 1^2 samples, faces NESWC of 360 px: requested",
        ),
        (RenderSettings(Tessellation(32, 32)), "raster, 32 x 32 polygons (uv), 2^2 samples"),
    ],
)
def test_plan_when_printed_has_numbers_and_reason(settings: RenderSettings, text: str) -> None:
    assert text in str(make_plan(settings))


def test_plan_of_trace_when_printed_has_no_faces() -> None:
    rays = "rays 4 px apart and along silhouettes"
    plan = make_plan(RenderSettings(), RendererKind.TRACE)
    assert str(plan) == f"trace, per pixel, 2^2 samples, {rays}: requested"
