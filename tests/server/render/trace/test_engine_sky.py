"""What rays show that meet nothing, by direction, for each engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.labels import SKY_CLASS
from catoptra_protocol.optics.cube_map import Face
from catoptra_server.effects import EffectMode, EffectSetting, EffectSettings, Threshold
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import apply_scene_effects, plan_effects
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.frames.labels import LabelledImage
from catoptra_server.frames.labels.label_renderer import LabelRenderer
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.render.trace.ray_table import face_ray_table
from catoptra_server.render.trace.trace_engine import TraceRequest
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.objects import CameraState, FogMedium, Shutter
from catoptra_server.world.panorama import make_panorama, texel_directions
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.sky import SkyDescription, compute_sky
from catoptra_server.world.world_description import Twist, srgb_from_linear
from helpers.motion_reference import average_frames
from helpers.trace_engines import ENGINES, open_engine, open_renderer, render_rays
from helpers.worlds import (
    CAMERA_STATE,
    make_omni_camera,
    make_plan,
    make_smooth_sky,
    make_test_world,
    under_sky,
)

SKY = make_smooth_sky()
WORLD = under_sky(make_test_world(), SKY)
EMPTY = under_sky(replace(make_test_world(), items=()), SKY)
ALL_WAYS = texel_directions(48).reshape(-1, 3)
ALL_WAYS /= np.linalg.norm(ALL_WAYS, axis=-1, keepdims=True)


@pytest.mark.parametrize("engine", ENGINES)
def test_ray_that_meets_nothing_has_the_radiance_of_its_direction(engine: EngineName) -> None:
    rotation = CAMERA_STATE.world_from_mirror.rotation
    shown = render_rays(engine, EMPTY, ALL_WAYS, exposure=CAMERA_STATE)
    # Of light up to 4: float32, of places in a map of 256 texels.
    np.testing.assert_allclose(shown, SKY.radiance(ALL_WAYS @ rotation.T), atol=2e-4)


@pytest.mark.parametrize("has_shadows", [False, True])
@pytest.mark.parametrize("samples", [1, 2])
def test_pictures_of_both_engines_are_the_same(samples: int, has_shadows: bool) -> None:
    state = replace(CAMERA_STATE, has_shadows=has_shadows)
    pictures = []
    for name in ENGINES:
        with open_engine(name, WORLD) as engine:
            rays = engine.prepare(face_ray_table(FaceCamera(Face.N, 64), samples))
            pictures.append(rays.render_srgb(state).astype(int))
    assert np.mean(np.abs(pictures[0] - pictures[1]) > 1) < 2e-3
    # The sky is in the picture, and no single colour is.
    assert len(np.unique(pictures[0][:16].reshape(-1, 3), axis=0)) > 100


def test_fog_hides_the_sky_and_measures_how_much_that_changes() -> None:
    fogged = replace(CAMERA_STATE, fog=FogMedium(0.05, (0.4, 0.4, 0.4)))
    request = TraceRequest(thresholds={"Fog": Threshold(300.0)})
    changes = []
    for name in ENGINES:
        with open_engine(name, EMPTY) as engine:
            rays = engine.prepare(face_ray_table(FaceCamera(Face.N, 64), 1))
            assert len(np.unique(rays.render_srgb(fogged).reshape(-1, 3), axis=0)) == 1
            changes.append(rays.render(fogged, request).changes["Fog"])
    assert changes[0].largest == pytest.approx(changes[1].largest, abs=0.6)
    assert changes[0].largest > 60.0


def test_moving_camera_blurs_the_sky_as_the_mean_of_instants() -> None:
    stripes = np.sin(24.0 * texel_directions(512)[..., :1]) > 0.0
    world = under_sky(make_test_world(), make_panorama(np.repeat(0.9 * stripes, 3, axis=-1)))
    camera = make_omni_camera()
    moving = replace(
        CAMERA_STATE,
        twist=Twist((0.0, 0.0, 0.0), (0.0, 0.0, 2.0)),
        shutter=Shutter(exposure_s=0.05, readout_s=0.0, num_steps=16.0),
    )
    pictures = []
    for name in ENGINES:
        with open_renderer(name, world) as renderer:
            view = renderer.prepare(camera, make_plan(camera, samples=2))
            pictures.append(view.render(moving).rgb.astype(int))
            view.close()
    difference = np.abs(pictures[0] - pictures[1]).max(axis=-1)
    assert np.percentile(difference, 99.0) <= 6


@pytest.mark.parametrize("turn_deg_s", [20.0, 60.0, 180.0])
@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0)], ids=["yaw", "pitch"])
def test_clouds_and_sun_blur_as_the_mean_of_64_frames(
    turn_deg_s: float, axis: tuple[float, float, float]
) -> None:
    clouds, _ = compute_sky(SkyDescription(0.58, -1.0, clouds=0.45, seed=6), 512)
    world, exposure_s = under_sky(replace(make_test_world(), items=()), clouds), 1.0 / 30.0
    camera, scene = make_omni_camera(width_px=160), build_scene(world)
    turn = (*(np.radians(turn_deg_s) * np.array(axis)).tolist(),)
    state = CameraState(CAMERA_STATE.world_from_mirror, twist=Twist((0.0, 0.0, 0.0), turn))
    summary = SceneSummarizer(scene, world).summarize(state, camera)
    blur = EffectSettings((EffectSetting(MotionBlur(exposure_s), EffectMode.ALWAYS),))
    moving = apply_scene_effects(state, plan_effects(blur, summary, camera))
    with open_renderer("kernel", world) as renderer:
        view = renderer.prepare(camera, make_plan(camera, samples=2))
        frames = average_frames(view, state, exposure_s, 64)
        pictures = (view.render_linear(moving), frames)
        levels = [np.rint(255.0 * srgb_from_linear(one)) for one in pictures]
        view.close()
    assert np.mean(np.abs(levels[0] - levels[1]).max(axis=-1) <= 2.0) >= 0.99


def test_labels_of_the_sky_are_its_class_without_object_or_range() -> None:
    camera = make_omni_camera()
    with open_renderer("kernel", WORLD) as renderer:
        labels = LabelRenderer(renderer, build_scene(WORLD))
        image = LabelledImage(camera, CAMERA_STATE)
        found = labels.render(image, ("classes", "valid", "range")).channels
        ids = labels.render(image, ("ids",)).channels["ids"]
        labels.close()
    is_open = (found["valid"] == 1) & (ids == 0)
    assert is_open.any()
    np.testing.assert_array_equal(found["classes"] == SKY_CLASS, is_open)
    assert np.isinf(found["range"][is_open]).all()
    with open_renderer("kernel", make_test_world()) as renderer:
        labels = LabelRenderer(renderer, build_scene(WORLD))
        plain = labels.render(image, ("classes",)).channels["classes"]
        labels.close()
    np.testing.assert_array_equal(plain, np.where(is_open, 0, found["classes"]))
