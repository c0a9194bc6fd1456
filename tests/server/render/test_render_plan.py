"""Validity of plans, and their description."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Tessellation
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=360)


def make_plan(settings: RenderSettings, kind: RendererKind = RendererKind.RASTER) -> RenderPlan:
    return plan_from_settings(settings, CAMERA, kind=kind, reason="requested")


@pytest.mark.parametrize("samples", [-1, 17])
def test_plan_without_or_with_too_many_samples_is_rejected(samples: int) -> None:
    with pytest.raises(DomainError, match="1 to 16"):
        make_plan(RenderSettings(samples=samples))


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
    plan = make_plan(RenderSettings(), RendererKind.TRACE)
    assert str(plan) == "trace, per pixel, 2^2 samples: requested"
