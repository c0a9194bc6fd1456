"""Variants of a camera, and the choice between exact rays and one viewpoint."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera_rays import near_limit_m, pixel_from_point, ray_from_pixel
from catoptra_protocol.optics.lenses import EquidistantLens
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, SphericalMirror
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.stream.requests import FrameVariant
from catoptra_server.effects import EffectMode, EffectSetting, EffectSettings
from catoptra_server.effects.medium.vignetting import Vignetting
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.frames.plan.camera import (
    MAX_SAMPLES,
    POLYGON_COUNTS,
    CameraVariant,
    OmniCameraSpec,
    ReferenceKind,
    choose_viewpoint,
    describe_viewpoint,
    explain_viewpoint,
    shows_ego_body,
)
from catoptra_server.render.renderer import AccuracyTarget, PerPixel, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Tessellation
from helpers.mirror_checks import make_camera
from helpers.worlds import make_omni_camera

MESH = Tessellation(8, 8)
EFFECTS = EffectSettings((EffectSetting(Vignetting(), EffectMode.AUTO),))
CAMERA = OmniCameraSpec(
    make_omni_camera(width_px=100),
    RenderSettings(surface=MESH, samples=3, accuracy_target=AccuracyTarget(0.5, 20.0)),
    EFFECTS,
)


def test_variant_without_changes_is_the_camera_itself() -> None:
    assert CameraVariant().apply_to(CAMERA) == CAMERA
    assert CameraVariant().make_reference(CAMERA) is None


def test_tolerance_and_budget_change_one_by_one() -> None:
    target = CameraVariant(max_error_px=2.0).apply_to(CAMERA).render_settings.accuracy_target
    assert target == AccuracyTarget(2.0, 20.0)
    target = CameraVariant(budget_ms=0.0).apply_to(CAMERA).render_settings.accuracy_target
    assert target == AccuracyTarget(0.5, 0.0)


@pytest.mark.parametrize("polygons", POLYGON_COUNTS)
def test_polygons_take_the_place_of_the_target(polygons: int) -> None:
    settings = CameraVariant(polygons=polygons).apply_to(CAMERA).render_settings
    assert isinstance(settings.surface, Tessellation)
    assert settings.surface.num_polygons == polygons
    assert settings.accuracy_target == AccuracyTarget()
    assert settings.samples == 3


@pytest.mark.parametrize("is_approximated", [False, True])
def test_polygons_need_a_mirror_with_one_viewpoint(is_approximated: bool) -> None:
    ball = make_omni_camera(mirror=SphericalMirror(0.03, 0.2, math.radians(120.0)))
    camera = dataclasses.replace(
        CAMERA, camera=dataclasses.replace(ball, is_approximated=is_approximated)
    )
    with pytest.raises(DomainError, match=r"0 polygons.*one viewpoint"):
        CameraVariant(polygons=64).apply_to(camera)
    assert CameraVariant(polygons=0).apply_to(camera).render_settings.surface == PerPixel()
    lens = dataclasses.replace(
        CAMERA,
        camera=camera_with_inscribed_rim(
            EquidistantLens(), width_px=100, height_px=100, rim_rad=1.5
        ),
    )
    with pytest.raises(DomainError, match="a mesh stands for a mirror"):
        CameraVariant(polygons=64).apply_to(lens)


def test_zero_polygons_are_the_exact_model() -> None:
    assert CameraVariant(polygons=0).apply_to(CAMERA).render_settings.surface == PerPixel()


def test_samples_and_renderer_change_nothing_else() -> None:
    variant = CameraVariant(samples=1, renderer=RendererKind.RASTER)
    settings = variant.apply_to(CAMERA).render_settings
    expected = RenderSettings(surface=MESH, samples=1, renderer="raster")
    assert settings == expected


def test_modes_of_effects_change_by_name() -> None:
    changed = CameraVariant(effects=(("Vignetting", EffectMode.NEVER),)).apply_to(CAMERA)
    assert [one.mode for one in changed.effect_settings.settings] == [EffectMode.NEVER]
    assert changed.render_settings == CAMERA.render_settings


def test_effect_that_the_camera_has_not_is_named() -> None:
    variant = CameraVariant(effects=(("Fog", EffectMode.ALWAYS),))
    with pytest.raises(DomainError, match="no effect 'Fog': it has Vignetting"):
        variant.apply_to(CAMERA)


def test_exact_reference_has_the_variant_s_effects_and_the_best_settings() -> None:
    modes = (("Vignetting", EffectMode.ALWAYS),)
    variant = CameraVariant(polygons=16, effects=modes, reference=ReferenceKind.EXACT)
    reference = variant.make_reference(CAMERA)
    assert reference is not None
    assert reference.render_settings == RenderSettings(samples=MAX_SAMPLES, renderer="trace")
    assert [one.mode for one in reference.effect_settings.settings] == [EffectMode.ALWAYS]


def test_reference_of_the_camera_is_the_camera() -> None:
    variant = CameraVariant(polygons=16, reference=ReferenceKind.CAMERA)
    assert variant.make_reference(CAMERA) == CAMERA


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"polygons": 17}, "17 polygons: expected one of 0, 16, 64"),
        ({"samples": 0}, "samples are 1 to 4"),
        ({"samples": 5}, "samples are 1 to 4"),
        ({"max_error_px": -1.0}, "max_error_px"),
        ({"budget_ms": float("nan")}, "budget_ms"),
        ({"effects": (("a", EffectMode.AUTO),) * 65}, "at most 64"),
    ],
)
def test_impossible_variant_is_refused_with_the_reason(
    changes: dict[str, object], reason: str
) -> None:
    with pytest.raises(DomainError, match=reason):
        dataclasses.replace(CameraVariant(), **changes)  # type: ignore[arg-type] # by case


def test_variant_of_a_request_has_its_values() -> None:
    request = FrameVariant(
        1.0, 2.0, 64, 3, "raster", {"b": "auto", "a": "never"}, "exact", "flipped"
    )
    modes = (("a", EffectMode.NEVER), ("b", EffectMode.AUTO))
    assert CameraVariant.from_request(request) == CameraVariant(
        1.0, 2.0, 64, 3, RendererKind.RASTER, modes, ReferenceKind.EXACT, Picture.FLIPPED
    )
    assert CameraVariant.from_request(FrameVariant()) == CameraVariant()


@pytest.mark.parametrize(
    ("request_", "reason"),
    [
        (FrameVariant(renderer="vulkan"), "no renderer 'vulkan': expected one of trace, raster"),
        (FrameVariant(reference="best"), "no reference 'best'"),
        (FrameVariant(picture="x"), "no picture 'x'"),
        (FrameVariant(effects={"a": "on"}), "no mode 'on'"),
    ],
)
def test_unknown_name_in_a_request_is_refused_with_the_known_ones(
    request_: FrameVariant, reason: str
) -> None:
    with pytest.raises(DomainError, match=reason):
        CameraVariant.from_request(request_)


BALL = make_camera(SphericalMirror(0.03, 0.2), 360)
AUTO = OmniCameraSpec(BALL, RenderSettings(central_error_px=0.25))
NEVER = OmniCameraSpec(BALL, RenderSettings())
ALWAYS = OmniCameraSpec(replace(BALL, is_approximated=True), RenderSettings())
PRECISE = OmniCameraSpec(
    BALL, RenderSettings(central_error_px=0.25, accuracy_target=AccuracyTarget(max_error_px=0.5))
)
CENTRAL = OmniCameraSpec(
    camera_with_inscribed_rim(PAPER_MIRROR, width_px=90, height_px=90, rim_rad=2.0),
    RenderSettings(central_error_px=0.25),
)
LIMIT_M = near_limit_m(BALL)


def test_viewpoint_is_one_from_the_near_limit_on() -> None:
    assert choose_viewpoint(AUTO, 0.999 * LIMIT_M) is AUTO
    far = choose_viewpoint(AUTO, 1.001 * LIMIT_M)
    assert far.camera == ALWAYS.camera
    assert far.render_settings == AUTO.render_settings


def test_points_from_the_near_limit_on_err_by_the_allowed_pixels() -> None:
    far = choose_viewpoint(AUTO, LIMIT_M).camera
    u, v = np.meshgrid(np.arange(5.0, 360.0, 7.0), np.arange(5.0, 360.0, 7.0))
    origins, directions, valid = ray_from_pixel(BALL, np.stack((u, v), axis=-1))
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
