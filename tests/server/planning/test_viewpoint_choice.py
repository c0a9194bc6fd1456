"""Exact rays where something is near, one viewpoint where nothing is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.camera_rays import near_limit_m, pixel_from_point, ray_from_pixel
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, SphericalMirror
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_server.effects.effect import EffectMode, EffectSetting, EffectSettings
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.frames.plan.camera import (
    OmniCameraSpec,
    choose_viewpoint,
    describe_viewpoint,
    explain_viewpoint,
    leaves_choice,
    shows_ego_body,
)
from catoptra_server.render.render_settings import AccuracyTarget, RenderSettings
from helpers.mirror_checks import make_camera

CAMERA = make_camera(SphericalMirror(0.03, 0.2), 360)
AUTO = OmniCameraSpec(CAMERA, RenderSettings(central_error_px=0.25))
NEVER = OmniCameraSpec(CAMERA, RenderSettings())
ALWAYS = OmniCameraSpec(replace(CAMERA, is_approximated=True), RenderSettings())
PRECISE = OmniCameraSpec(
    CAMERA,
    RenderSettings(central_error_px=0.25, accuracy_target=AccuracyTarget(max_error_px=0.5)),
)
CENTRAL = OmniCameraSpec(
    camera_with_inscribed_rim(PAPER_MIRROR, width_px=90, height_px=90, rim_rad=2.0),
    RenderSettings(central_error_px=0.25),
)
LIMIT_M = near_limit_m(CAMERA)


@pytest.mark.parametrize(
    ("spec", "expected"),
    [(AUTO, True), (NEVER, False), (ALWAYS, False), (CENTRAL, False), (PRECISE, False)],
)
def test_only_auto_leaves_a_choice(spec: OmniCameraSpec, expected: bool) -> None:
    assert leaves_choice(spec) is expected


def test_viewpoint_is_one_from_the_near_limit_on() -> None:
    assert choose_viewpoint(AUTO, 0.999 * LIMIT_M) is AUTO
    far = choose_viewpoint(AUTO, 1.001 * LIMIT_M)
    assert far.camera == ALWAYS.camera
    assert far.render_settings == AUTO.render_settings


def test_points_from_the_near_limit_on_err_by_the_allowed_pixels() -> None:
    far = choose_viewpoint(AUTO, LIMIT_M).camera
    u, v = np.meshgrid(np.arange(5.0, 360.0, 7.0), np.arange(5.0, 360.0, 7.0))
    origins, directions, valid = ray_from_pixel(CAMERA, np.stack((u, v), axis=-1))
    # Points of the rays at the limit's distance from the viewpoint.
    along = (origins * directions).sum(axis=-1)
    half = along**2 - (origins**2).sum(axis=-1) + LIMIT_M**2
    points = (origins + (np.sqrt(half) - along)[..., None] * directions)[valid]
    found, shown = pixel_from_point(far, points)
    errors = np.linalg.norm(found - np.stack((u, v), axis=-1)[valid], axis=-1)[shown]
    assert 0.2 < errors.max() < 0.25 * 1.02


def test_plan_says_from_which_distance_one_viewpoint_holds() -> None:
    limit = f"{LIMIT_M:.3g} m"
    assert describe_viewpoint(AUTO) == f"exact rays while anything is nearer than {limit}"
    far = choose_viewpoint(AUTO, 2.0 * LIMIT_M)
    assert describe_viewpoint(far) == f"one viewpoint for all rays: nothing is nearer than {limit}"
    assert describe_viewpoint(NEVER) == f"exact rays, central from {limit}"
    assert describe_viewpoint(ALWAYS) == f"one viewpoint for all rays, central from {limit}"
    assert describe_viewpoint(PRECISE) == f"exact rays, central from {limit}"
    assert describe_viewpoint(CENTRAL) == ""


def test_explanation_has_miss_limit_and_clearance() -> None:
    line = explain_viewpoint(AUTO, 0.5)
    assert "mm; central to 0.25 px from" in line
    assert f"{LIMIT_M:.3g} m; nothing is nearer than 0.5 m here" in line
    assert explain_viewpoint(CENTRAL, 0.5) == ""


def test_own_robot_is_in_view_where_its_effect_is_named() -> None:
    effects = EffectSettings((EffectSetting(SelfView(), EffectMode.AUTO),))
    assert shows_ego_body(replace(AUTO, effect_settings=effects))
    assert not shows_ego_body(AUTO)
