"""Rounding errors; tests/server/render/test_error_bound.py compares them with rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import (
    PAPER_MIRROR,
    HyperbolicMirror,
    Mirror,
    ParabolicMirror,
    SphericalMirror,
)
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_server.frames.plan.error_bound import coordinate_errors, corner_error, rounding_error
from catoptra_server.frames.plan.faces import texel_footprint
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.projection.atlas import GUARD_TEXELS, atlas_coordinates, pack_atlas
from catoptra_server.render.render_settings import MirrorSurface, PerPixel, RenderSettings
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Tessellation
from helpers.mirror_checks import make_camera as make_ball_camera
from helpers.worlds import make_omni_camera


def make_plan(camera: OmniCamera, kind: RendererKind, surface: MirrorSurface) -> RenderPlan:
    return plan_from_settings(RenderSettings(surface), camera, kind=kind, reason="test")


def rounding_px(
    camera: OmniCamera,
    kind: RendererKind,
    surface: MirrorSurface = PerPixel(),  # noqa: B008 - frozen
) -> float:
    return rounding_error(camera, make_plan(camera, kind, surface)).max_px


@pytest.mark.parametrize(
    ("mirror", "rim_deg"),
    [(PAPER_MIRROR, 120.0), (HyperbolicMirror(2.1, 0.2), 100.0), (ParabolicMirror(0.03), 135.0)],
    ids=str,
)
def test_atlas_coordinates_are_more_precise_than_their_bound(
    mirror: Mirror, rim_deg: float
) -> None:
    camera = make_omni_camera(mirror=mirror, width_px=640, rim_deg=rim_deg)
    plan = make_plan(camera, RendererKind.RASTER, PerPixel())
    atlas = pack_atlas(plan.face_regions, guard_texels=GUARD_TEXELS, max_texels=16384)
    pixels = pixel_sample_positions(camera)[::3, ::3, 0]
    directions, on_mirror = direction_from_pixel(camera, pixels)
    size = np.array((atlas.width, atlas.height), dtype=np.float32)
    # As a sampler does it, in float32.
    held = (atlas_coordinates(camera, atlas, pixels) * size).astype(np.float64)
    moved = (held - atlas.texels_from_direction(directions))[on_mirror]
    seen_px = (
        np.linalg.norm(moved, axis=-1).max() * texel_footprint(camera, plan.face_regions).max_px
    )
    assert 0.0 < seen_px <= rounding_px(camera, RendererKind.RASTER) < 5e-3


def test_directions_of_a_mesh_are_rounded_too() -> None:
    camera = make_omni_camera(width_px=360)
    tessellation = Tessellation(16, 16)
    assert rounding_px(camera, RendererKind.RASTER, tessellation) > rounding_px(
        camera, RendererKind.RASTER
    )


def test_rounding_of_rays_is_far_below_visibility() -> None:
    # Unit vectors in float32 are good to 6e-8; times up to 210 px a radian at the rim.
    assert 1e-5 < rounding_px(make_omni_camera(width_px=360), RendererKind.TRACE) < 5e-5


def test_rounding_grows_with_the_image() -> None:
    small, large = (
        rounding_px(make_omni_camera(width_px=w), RendererKind.TRACE) for w in (90, 900)
    )
    assert large == pytest.approx(10.0 * small)


def test_corner_error_falls_with_more_samples() -> None:
    camera = make_omni_camera(width_px=360)
    assert corner_error(camera, 1).max_px == pytest.approx(2**0.5 / 512.0)
    assert corner_error(camera, 4).max_px == pytest.approx(2**0.5 / 2048.0)


def test_miss_of_an_approximated_viewpoint_counts_where_a_renderer_has_one() -> None:
    camera = make_ball_camera(SphericalMirror(0.03, 0.2))
    trace, raster = (
        plan_from_settings(RenderSettings(), camera, kind=kind, reason="")
        for kind in (RendererKind.TRACE, RendererKind.RASTER)
    )
    assert coordinate_errors(camera, trace).miss_m == 0.0
    approximated = replace(camera, is_approximated=True)
    for plan in (trace, raster):
        assert coordinate_errors(approximated, plan).miss_m == pytest.approx(7.5e-3, abs=1e-4)
