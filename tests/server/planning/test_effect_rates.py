"""The rates know every effect, and what a camera may need is what no bound proves needless."""

from __future__ import annotations

from functools import cache

import pytest

from catoptra_server.config.bundled_files import find_configuration
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.effect import NO_EFFECT_SETTINGS
from catoptra_server.planning.effect_rates import (
    RenderEngine,
    find_possible_effects,
    predict_effects_ms,
)
from catoptra_server.planning.renderer_choice import choose_renderer
from catoptra_server.planning.renderer_rule import ImageLoad
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.robot_description import OmniCameraDescription
from catoptra_server.startup import StartupConfig, read_startup_config

NAMES = [kind.name for kind in EFFECT_TYPES]


@cache
def load(robot: str, world: str = "four_legged_2006") -> StartupConfig:
    return read_startup_config(
        [find_configuration("robots", robot)], find_configuration("worlds", world)
    )


def omni_camera(robot: str) -> OmniCameraDescription:
    omni = load(robot).robots[0].omni_camera
    assert omni is not None
    return omni


@pytest.mark.parametrize("engine", RenderEngine)
@pytest.mark.parametrize("name", NAMES)
def test_every_effect_has_a_rate_of_every_engine(engine: RenderEngine, name: str) -> None:
    one, four = (
        predict_effects_ms(engine, frozenset({name}), num_pixels=10**6, num_samples=samples)
        for samples in (10**6, 4 * 10**6)
    )
    assert one > 0.0
    # A pass over the finished image takes as long, however many samples its pixels have.
    is_traced = name in ("SelfView", "Shadows", "RollingShutter", "MotionBlur", "Fog")
    assert four == pytest.approx(4.0 * one if is_traced else one)


def test_effects_add_up() -> None:
    def predict(*names: str) -> float:
        return predict_effects_ms(
            RenderEngine.KERNEL, frozenset(names), num_pixels=10**6, num_samples=10**6
        )

    assert predict() == 0.0
    assert predict("Bayer", "Shadows") == pytest.approx(predict("Bayer") + predict("Shadows"))
    assert predict("Bayer", "none of these") == predict("Bayer")


def test_real_camera_needs_what_its_file_does_not_rule_out() -> None:
    omni = omni_camera("p2at_omni_real")
    names = find_possible_effects(omni.effects, omni.camera)
    assert {"SelfView", "Shadows", "MotionBlur", "MirrorDust", "ShotNoise", "Bayer"} <= names
    # Clear air, a global shutter, gains of one, an exposure that white fills, a mode never.
    assert not names & {"Fog", "RollingShutter", "WhiteBalance", "Exposure", "AutoExposure"}
    assert find_possible_effects(NO_EFFECT_SETTINGS, omni.camera) == frozenset()


@pytest.mark.parametrize("world", ["four_legged_2006", "corridor", "rescue"])
def test_auto_traces_the_real_camera_and_says_why(world: str) -> None:
    omni, startup = omni_camera("p2at_omni_real"), load("p2at_omni_real", world)
    image = ImageLoad.from_camera(omni.camera, omni.render_settings, omni.effects)
    choice = choose_renderer(
        "auto", startup.scene, startup.world, image=image, is_reproducible=True
    )
    choice.renderer.close()
    assert choice.kind is RendererKind.TRACE
    assert f"with {len(image.effects)} effects" in choice.reason
    assert "trace (kernel)" in choice.reason
    assert "raster (software OpenGL)" in choice.reason
