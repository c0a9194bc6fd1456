"""What float32 leaves; that it holds for rays is tests/server/render/test_error_bound.py."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.camera import OmniCamera, direction_from_pixel, pixel_centres
from catoptra_protocol.optics.mirrors import CentralMirror, HyperbolicMirror, ParabolicMirror
from catoptra_server.plan.face_texels import face_texels
from catoptra_server.plan.render_plan import (
    PerPixel,
    RendererKind,
    RenderPlan,
    RenderWish,
    Surface,
    plan_from_wish,
)
from catoptra_server.plan.rounding_error import corner_error, rounding_error
from catoptra_server.render.raster.atlas import GUARD_TEXELS, pack_atlas
from catoptra_server.render.raster.mirror_places import places_of
from catoptra_server.scene.mirror_mesh import PolygonSplit
from helpers.worlds import PAPER_MIRROR, omni_camera


def plan_of(camera: OmniCamera, kind: RendererKind, surface: Surface) -> RenderPlan:
    return plan_from_wish(RenderWish(surface), camera, kind=kind, why="test")


def rounding_px(
    camera: OmniCamera,
    kind: RendererKind,
    surface: Surface = PerPixel(),  # noqa: B008 - frozen
) -> float:
    return rounding_error(camera, plan_of(camera, kind, surface)).max_px


@pytest.mark.parametrize(
    ("mirror", "rim_deg"),
    [(PAPER_MIRROR, 120.0), (HyperbolicMirror(2.1, 0.2), 100.0), (ParabolicMirror(0.03), 135.0)],
    ids=str,
)
def test_places_in_the_atlas_are_held_better_than_their_part(
    mirror: CentralMirror, rim_deg: float
) -> None:
    camera = omni_camera(mirror=mirror, width_px=640, rim_deg=rim_deg)
    plan = plan_of(camera, RendererKind.RASTER, PerPixel())
    atlas = pack_atlas(plan.face_parts, guard=GUARD_TEXELS, max_texels=16384)
    pixels = pixel_centres(camera)[::3, ::3, 0]
    directions, on_mirror = direction_from_pixel(camera, pixels)
    size = np.array((atlas.width, atlas.height), dtype=np.float32)
    # As a sampler does it, in float32.
    held = (places_of(camera, atlas, pixels) * size).astype(np.float64)
    moved = (held - atlas.texels_from_direction(directions))[on_mirror]
    seen_px = np.linalg.norm(moved, axis=-1).max() * face_texels(camera, plan.face_parts).max_px
    assert 0.0 < seen_px <= rounding_px(camera, RendererKind.RASTER) < 5e-3


def test_directions_of_polygons_are_rounded_too() -> None:
    camera = omni_camera(width_px=360)
    split = PolygonSplit(16, 16)
    assert rounding_px(camera, RendererKind.RASTER, split) > rounding_px(
        camera, RendererKind.RASTER
    )


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
