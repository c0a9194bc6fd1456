"""The rule grows with what costs time, and knows nothing of the machine."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

from catoptra_server.effects.effect import EffectMode, EffectSetting, EffectSettings
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.sensor.bayer import Bayer
from catoptra_server.effects.sensor.shot_noise import ShotNoise
from catoptra_server.planning.effect_rates import RenderEngine, predict_effects_ms
from catoptra_server.planning.renderer_rule import (
    ImageLoad,
    RendererRule,
    SceneLoad,
    largest_image,
    predict_frame_ms,
    rule_features,
)
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.world_description import HemisphereLight, PointLight
from helpers.worlds import make_omni_camera, make_test_world

SCENE = SceneLoad(num_triangles=2000, has_textures=False, num_point_lights=0)
IMAGE = ImageLoad(640 * 640, samples=2)
WHITE = (1.0, 1.0, 1.0)


@pytest.mark.parametrize("engine", RenderEngine)
@pytest.mark.parametrize(
    ("scene", "image"),
    [
        (SCENE, ImageLoad(360 * 360, samples=2)),
        (SCENE, ImageLoad(640 * 640, samples=1)),
        (replace(SCENE, num_triangles=0), IMAGE),
    ],
    ids=["pixels", "samples", "triangles"],
)
def test_frame_takes_longer_with_more_of_each_quantity(
    engine: RenderEngine, scene: SceneLoad, image: ImageLoad
) -> None:
    if engine is not RenderEngine.REFERENCE or scene == SCENE:
        assert predict_frame_ms(engine, scene, image) < predict_frame_ms(engine, SCENE, IMAGE)


@pytest.mark.parametrize("engine", [RenderEngine.KERNEL, RenderEngine.REFERENCE])
def test_traced_frame_takes_longer_with_textures_and_lights(engine: RenderEngine) -> None:
    scenes = (SCENE, replace(SCENE, has_textures=True), replace(SCENE, num_point_lights=2))
    plain, *others = (predict_frame_ms(engine, scene, IMAGE) for scene in scenes)
    assert all(other > plain for other in others)


def test_every_quantity_of_an_engine_has_a_rate_that_is_not_negative() -> None:
    for engine in RenderEngine:
        features = rule_features(
            engine, replace(SCENE, has_textures=True, num_point_lights=1), IMAGE
        )
        assert all(feature > 0.0 for feature in features)
        assert predict_frame_ms(engine, SCENE, ImageLoad(num_pixels=0)) >= 0.0


KERNEL, REFERENCE, OPENGL = RenderEngine


@pytest.mark.parametrize(
    ("scene", "side_px", "samples", "expected"),
    [
        (SceneLoad(2840, has_textures=False, num_point_lights=0), 640, 4, KERNEL),
        (SceneLoad(846, has_textures=True, num_point_lights=0), 640, 1, KERNEL),
        (SceneLoad(846, has_textures=True, num_point_lights=0), 640, 4, KERNEL),
        (SceneLoad(2840, has_textures=False, num_point_lights=2), 640, 1, KERNEL),
        (SceneLoad(2840, has_textures=False, num_point_lights=2), 640, 3, OPENGL),
        (SceneLoad(2840, has_textures=False, num_point_lights=2), 1024, 2, OPENGL),
        (SceneLoad(58_502, has_textures=False, num_point_lights=0), 1024, 2, KERNEL),
        (SceneLoad(975_002, has_textures=False, num_point_lights=0), 640, 2, KERNEL),
    ],
)
def test_rule_picks_the_engine_that_was_measured_as_faster(
    scene: SceneLoad, side_px: int, samples: int, expected: RenderEngine
) -> None:
    image = ImageLoad(side_px**2, samples)
    times = {engine: predict_frame_ms(engine, scene, image) for engine in RenderEngine}
    assert min(times, key=lambda engine: times[engine]) is expected


def test_reference_is_slower_than_software_opengl_in_all_scenes_but_huge_ones() -> None:
    loads = itertools.product((360, 640, 1024), (1, 2, 3), (100, 60_000), (False, True), (0, 2))
    for side, samples, triangles, textures, lights in loads:
        scene, image = SceneLoad(triangles, textures, lights), ImageLoad(side**2, samples)
        assert predict_frame_ms(OPENGL, scene, image) < predict_frame_ms(REFERENCE, scene, image)


def test_rule_finds_the_fastest_of_the_engines_and_explains_it() -> None:
    engines = {
        RendererKind.TRACE: RenderEngine.REFERENCE,
        RendererKind.RASTER: RenderEngine.SOFTWARE_OPENGL,
    }
    rule = RendererRule(replace(SCENE, has_textures=True, num_point_lights=2), engines)
    assert rule.find_fastest(IMAGE) is RendererKind.RASTER
    text = rule.explain(IMAGE)
    for part in (
        "trace (reference)",
        "raster (software OpenGL)",
        "2 x 2",
        "2000",
        "textures",
        "2 p",
    ):
        assert part in text


def test_rule_has_no_time_of_a_renderer_without_rates() -> None:
    rule = RendererRule(SCENE, {RendererKind.TRACE: RenderEngine.KERNEL})
    assert rule.predict_frame_ms(RendererKind.RASTER, IMAGE) is None
    assert rule.find_fastest(IMAGE) is RendererKind.TRACE


def test_load_of_a_scene_counts_triangles_and_point_lights() -> None:
    mesh = build_scene(make_test_world())
    lights = (HemisphereLight(WHITE, WHITE), PointLight((0.0, 0.0, -1.0), WHITE))
    assert SceneLoad.from_scene(mesh, lights) == SceneLoad(len(mesh), bool(mesh.textures), 1)


def test_image_counts_the_effects_that_a_camera_may_need() -> None:
    camera = make_omni_camera(width_px=100)
    settings = RenderSettings(samples=2)
    effects = EffectSettings(
        (
            EffectSetting(ShotNoise(18000.0), EffectMode.AUTO),
            EffectSetting(Bayer(), EffectMode.NEVER),
        )
    )
    image = ImageLoad.from_camera(camera, settings, effects)
    assert image == ImageLoad(100 * 100, 2, frozenset({"ShotNoise"}))
    assert "with 1 effects" in str(image)
    assert ImageLoad.from_camera(camera, settings).effects == frozenset()


@pytest.mark.parametrize("engine", RenderEngine)
def test_effects_lengthen_a_frame_by_their_rates(engine: RenderEngine) -> None:
    noisy = replace(IMAGE, effects=frozenset({"ShotNoise", "Shadows"}))
    added_ms = predict_frame_ms(engine, SCENE, noisy) - predict_frame_ms(engine, SCENE, IMAGE)
    expected_ms = predict_effects_ms(
        engine, noisy.effects, num_pixels=IMAGE.num_pixels, num_samples=IMAGE.num_samples
    )
    assert added_ms == pytest.approx(expected_ms)
    assert added_ms > 0.0


def test_largest_image_takes_longest() -> None:
    small, large = make_omni_camera(width_px=100), make_omni_camera(width_px=120)
    none = EffectSettings()
    cameras = [(large, RenderSettings(samples=1), none), (small, RenderSettings(samples=2), none)]
    assert largest_image(cameras) == ImageLoad(100 * 100, 2)
    assert largest_image([]).num_samples == 0
    # An image of half the size with costly effects takes longer than a plain one.
    blurred = EffectSettings((EffectSetting(MotionBlur(1.0 / 60.0), EffectMode.AUTO),))
    cameras = [
        (large, RenderSettings(samples=2), none),
        (small, RenderSettings(samples=2), blurred),
    ]
    assert largest_image(cameras).effects == {"MotionBlur"}
