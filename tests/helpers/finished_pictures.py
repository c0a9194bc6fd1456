"""The shipped real camera in more or less light, with the exposure that makes daylight of it: the
picture with effects by their criteria beside the picture with all effects."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from math import cos, sin
from pathlib import Path

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_server.commands.explain import PlanarVelocity, build_camera_state
from catoptra_server.config.startup import StartupConfig, read_startup_config
from catoptra_server.effects import EffectMode, EffectSetting, widest_gains
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.effects.sensor.auto_exposure import AutoExposure
from catoptra_server.effects.sensor.exposure import Exposure
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import RenderedView, ViewCache
from catoptra_server.simulation.robot_description import OmniCameraDescription, PlanarPose
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import (
    HemisphereLight,
    Light,
    PointLight,
    World,
)

_CONFIGS = Path(__file__).parents[2] / "configs"
DRIVING = PlanarVelocity(0.5, 0.0, 0.5)
_RANDOM = frozenset({"ShotNoise", "ReadNoise", "FixedPattern"})


@cache
def real_camera_in(world: str) -> StartupConfig:
    """The shipped real camera in a shipped world."""
    robot = _CONFIGS / "robots" / "p2at_omni_real.ini"
    return read_startup_config([robot], _CONFIGS / "worlds" / f"{world}.ini")


def dim(world: World, factor: float) -> World:
    """The world with all of its light, the background's included, times a factor."""
    red, green, blue = world.background
    background = (factor * red, factor * green, factor * blue)
    lights = tuple(_dim_light(light, factor) for light in world.lights)
    return replace(world, lights=lights, background=background)


def _dim_light(light: Light, factor: float) -> Light:
    def times(colour: tuple[float, float, float]) -> tuple[float, float, float]:
        return factor * colour[0], factor * colour[1], factor * colour[2]

    if isinstance(light, HemisphereLight):
        return HemisphereLight(times(light.up_irradiance), times(light.down_irradiance))
    if isinstance(light, PointLight):
        return replace(light, intensity=times(light.intensity))
    return replace(light, irradiance=times(light.irradiance))


def draw_pair(
    world: str,
    factor: float,
    *,
    width_px: int = 120,
    max_gain: float | None = None,
    exposure: float = 1.0,
    renderer: str = "trace",
    velocity: PlanarVelocity = DRIVING,
    toggled: str = "",
    has_all: bool = False,
    is_clean: bool = False,
) -> tuple[RenderedView, RenderedView]:
    """Pictures with effects by their criteria, and with all of them or without one; no noise.

    Args:
        world: Name of a shipped world.
        factor: Factor of all light.
        width_px: Side of the image.
        max_gain: Largest gain of an automatic exposure; None for the exposure time alone.
        exposure: Times that of daylight.
        renderer: `trace` or `raster`.
        velocity: Motion of the robot.
        toggled: Effect that the second picture has where the criteria leave it out, and the other
            way round; all others, and all of the first picture, are forced to what they decide.
        is_clean: Whether the first picture has no effect.
        has_all: Whether effects that the file has in mode never have their criterion, too.
    """
    with _open_camera(world, factor / exposure, factor, width_px, max_gain, renderer) as camera:
        state = camera.place(velocity)
        settings = tuple(
            replace(one, mode=EffectMode.AUTO)
            if has_all and one.effect.name not in _RANDOM
            else one
            for one in camera.settings
            if not is_clean
        )
        first = camera.draw(settings, state)
        if not toggled:
            others = tuple(_force(one, EffectMode.ALWAYS) for one in settings)
            return first, camera.draw(others, state)
        on = {one.effect for one in first.effect_decisions if one.enabled}
        plain, other = (
            camera.draw(_force_to(settings, names), state) for names in (on, on ^ {toggled})
        )
        return replace(first, image=plain.image), other


def _force_to(settings: tuple[EffectSetting, ...], on: set[str]) -> tuple[EffectSetting, ...]:
    """Settings with some effects everywhere, and without all others."""
    modes = (EffectMode.NEVER, EffectMode.ALWAYS)
    return tuple(replace(one, mode=modes[one.effect.name in on]) for one in settings)


def draw_path(world: str, distances_m: Sequence[float]) -> list[tuple[EffectDecision, ...]]:
    """Decisions about effects by their criteria, at distances ahead of the start."""
    with _open_camera(world, 1.0, 1.0, 120, None, "trace") as camera:
        states = [camera.place(DRIVING, ahead_m) for ahead_m in distances_m]
        return [camera.draw(camera.settings, one).effect_decisions for one in states]


@dataclass(frozen=True)
class _OpenCamera:
    """The real camera in a world, and its views."""

    startup: StartupConfig
    omni: OmniCameraDescription
    spec: OmniCameraSpec
    views: ViewCache

    @property
    def settings(self) -> tuple[EffectSetting, ...]:
        """Settings of the camera's effects."""
        return self.spec.effect_settings.settings

    def place(self, velocity: PlanarVelocity, ahead_m: float = 0.0) -> CameraState:
        """State of the camera ahead of the world's start."""
        start = self.startup.world.starts[0] if self.startup.world.starts else None
        x, y, yaw = (*start.location_m[:2], start.rotation_rad[2]) if start else (0.0, 0.0, 0.0)
        pose = PlanarPose(x + ahead_m * cos(yaw), y + ahead_m * sin(yaw), yaw)
        return build_camera_state(self.startup.robots[0], self.omni, pose, velocity)

    def draw(self, settings: tuple[EffectSetting, ...], state: CameraState) -> RenderedView:
        """Picture with effects."""
        effects = replace(self.spec.effect_settings, settings=settings)
        spec = OmniCameraSpec(self.spec.camera, self.spec.render_settings, effects)
        return self.views.render(ViewRequest(spec, state))


@contextmanager
def _open_camera(
    world: str,
    exposed: float,
    factor: float,
    width_px: int,
    max_gain: float | None,
    renderer: str,
) -> Iterator[_OpenCamera]:
    startup = real_camera_in(world)
    dimmed = dim(startup.world, factor)
    omni = startup.robots[0].omni_camera
    assert omni is not None
    camera = camera_with_inscribed_rim(
        omni.camera.mirror, width_px=width_px, height_px=width_px, rim_rad=omni.camera.rim_rad
    )
    named = tuple(_expose(one, exposed, max_gain) for one in omni.effects.settings)
    # What is left out is to be invisible, wherever it is.
    by_criteria = replace(omni.effects, settings=named, max_change=0.5, visible_share=0.0)
    choice = choose_renderer(
        renderer, startup.scene, dimmed, threads=2, gains=widest_gains((by_criteria,))
    )
    views = ViewCache(RenderPlanner(RendererPool(choice)), SceneSummarizer(startup.scene, dimmed))
    spec = OmniCameraSpec(camera, omni.render_settings, by_criteria)
    try:
        yield _OpenCamera(startup, omni, spec, views)
    finally:
        views.close()


def _force(setting: EffectSetting, mode: EffectMode) -> EffectSetting:
    return setting if setting.mode is EffectMode.NEVER else replace(setting, mode=mode)


def _expose(setting: EffectSetting, dimmed: float, max_gain: float | None) -> EffectSetting:
    effect = setting.effect
    if effect.name in _RANDOM:
        return replace(setting, mode=EffectMode.NEVER)
    if isinstance(effect, AutoExposure) and max_gain is not None:
        effect = replace(effect, max_gain=max_gain, min_gain=1.0 / max_gain)
        return EffectSetting(effect, EffectMode.AUTO)
    if isinstance(effect, Exposure) and max_gain is None:
        brighter = replace(effect, white_exposure_s=dimmed * effect.exposure_s)
        return EffectSetting(brighter, setting.mode)
    return setting


def find_differences(pair: tuple[RenderedView, RenderedView]) -> Floats:
    """(h, w) largest difference of each pixel, grey levels."""
    one, other = (view.image.rgb.astype(np.float64) for view in pair)
    differences: Floats = np.abs(one - other).max(axis=-1)
    return differences
