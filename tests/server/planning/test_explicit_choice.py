"""A renderer whose faces cannot show the image is replaced, or refused with the reason."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.plans import choose_by_settings
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from helpers.worlds import make_omni_camera

TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER


def make_spec(k: float, *, width_px: int = 64, **settings: int | str) -> OmniCameraSpec:
    camera = make_omni_camera(mirror=HyperbolicMirror(k, 0.1), width_px=width_px, rim_deg=90.0)
    return OmniCameraSpec(camera, RenderSettings(**settings))  # type: ignore[arg-type]


@pytest.mark.parametrize("k", [2.1, 2.001, 2.00001])
def test_renderer_that_can_show_the_image_is_kept(k: float) -> None:
    choice = choose_by_settings(make_spec(k), RASTER, "test", usable=[TRACE, RASTER])
    assert (choice.plan.renderer, choice.plan.reason) == (RASTER, "test")


def test_mirror_next_to_two_takes_the_renderer_without_faces_and_says_why() -> None:
    choice = choose_by_settings(make_spec(2.0 + 1e-9), RASTER, "test", usable=[TRACE, RASTER])
    assert choice.plan.renderer is TRACE
    assert choice.plan.reason.startswith("the faces of raster would displace this camera's image")
    assert choice.bound is not None
    assert choice.bound.geometric.max_px < 1.0


@pytest.mark.parametrize("usable", [[RASTER], []])
def test_mirror_next_to_two_without_another_renderer_is_an_error(
    usable: list[RendererKind],
) -> None:
    with pytest.raises(DomainError, match="by 50 of 64 px: choose the renderer trace"):
        choose_by_settings(make_spec(2.0 + 1e-9), RASTER, "test", usable=usable)


def test_renderer_that_a_client_requests_is_not_replaced() -> None:
    spec = make_spec(2.0 + 1e-9, renderer="raster")
    with pytest.raises(DomainError, match="choose the renderer trace"):
        choose_by_settings(spec, RASTER, "as requested", usable=[TRACE, RASTER])


def test_faces_of_a_configured_size_are_as_coarse_as_configured() -> None:
    spec = make_spec(2.5, width_px=640, face_size_px=8)
    choice = choose_by_settings(spec, RASTER, "test", usable=[TRACE, RASTER])
    assert choice.plan.renderer is RASTER
