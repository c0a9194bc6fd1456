"""What float32 leaves; that it holds for rays and shaders is tested beside them."""

from __future__ import annotations

import pytest

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_server.plan.render_plan import PerPixel, RendererKind, RenderWish, plan_from_wish
from catoptra_server.plan.rounding_error import SHADER_ULPS, corner_error, rounding_error
from helpers.worlds import PAPER_MIRROR, omni_camera


def rounding_px(camera: OmniCamera, kind: RendererKind) -> float:
    plan = plan_from_wish(RenderWish(PerPixel()), camera, kind=kind, why="test")
    return rounding_error(camera, plan).max_px


@pytest.mark.parametrize(
    ("mirror", "rim_deg", "width_px", "measured_px"),
    [
        # optics.md 1.2 and 7.4, and the same shader in a large image of a mirror that is nearly a
        # plane.
        (PAPER_MIRROR, 120.0, 360, 5.5e-5),
        (PAPER_MIRROR, 120.0, 4096, 5.6e-4),
        (HyperbolicMirror(2.1, 0.2), 100.0, 4096, 2.0e-3),
    ],
)
def test_law_in_the_shader_errs_less_than_its_part(
    mirror: HyperbolicMirror, rim_deg: float, width_px: int, measured_px: float
) -> None:
    camera = omni_camera(mirror=mirror, width_px=width_px, rim_deg=rim_deg)
    of_law = SHADER_ULPS / 3.0 * rounding_px(camera, RendererKind.TRACE)
    assert measured_px <= of_law
    assert of_law < rounding_px(camera, RendererKind.RASTER)


def test_rounding_of_rays_is_far_below_what_can_be_seen() -> None:
    # Unit vectors in float32 are good to 6e-8; times up to 210 px a radian at the rim.
    assert 1e-5 < rounding_px(omni_camera(width_px=360), RendererKind.TRACE) < 5e-5


def test_rounding_grows_with_the_image() -> None:
    small, large = (rounding_px(omni_camera(width_px=w), RendererKind.TRACE) for w in (90, 900))
    assert large == pytest.approx(10.0 * small)


def test_corners_of_polygons_stand_finer_with_more_samples() -> None:
    camera = omni_camera(width_px=360)
    assert corner_error(camera, 1).max_px == pytest.approx(2**0.5 / 512.0)
    assert corner_error(camera, 4).max_px == pytest.approx(2**0.5 / 2048.0)
