"""Sizes of views from plans and settings."""

from __future__ import annotations

from dataclasses import replace

import pytest

from catoptra_protocol.optics.mirrors import SphericalMirror
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.frames.plan.plans import (
    omni_view_size,
    perspective_view_size,
    plan_view_size,
)
from catoptra_server.render.render_settings import PerPixel, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.memory import ViewSize
from helpers.mirror_checks import make_camera
from helpers.worlds import make_omni_camera, make_plan

CAMERA = make_omni_camera(width_px=100)


def test_view_of_settings_has_their_samples_and_the_texels_of_five_faces() -> None:
    settings = RenderSettings(PerPixel(), samples=3, face_size_px=64, face_samples=2)
    size = omni_view_size(CAMERA, settings, has_effects=True)
    assert (size.num_pixels, size.samples_per_pixel, size.samples_per_texel) == (10_000, 9, 2)
    # Side faces up to the rim of 120 degrees, 45 degrees of them above the horizon in the corners.
    assert 4 * 64 * 64 < size.num_texels <= 5 * 64 * 64
    assert size.has_effects


def test_view_of_a_trace_plan_has_no_faces() -> None:
    plan = make_plan(CAMERA)
    assert plan_view_size(CAMERA, plan).num_texels > 0
    assert plan_view_size(CAMERA, replace(plan, renderer=RendererKind.TRACE)).num_texels == 0


@pytest.mark.parametrize(("width", "height"), [(320, 240), (1, 1)])
def test_view_of_a_perspective_camera_has_four_samples_a_pixel(width: int, height: int) -> None:
    size = perspective_view_size(PerspectiveCamera(width, height, 1.0))
    assert size == ViewSize(width * height, 4)


def test_rays_of_a_mirror_without_a_viewpoint_have_origins() -> None:
    ball = make_camera(SphericalMirror(0.03, 0.2), 100)
    exact, one = (
        omni_view_size(camera, RenderSettings(), has_effects=False)
        for camera in (ball, replace(ball, is_approximated=True))
    )
    assert exact == replace(one, has_origins=True)
    assert exact.num_bytes > one.num_bytes
