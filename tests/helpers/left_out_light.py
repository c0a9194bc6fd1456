"""Baked light and sky by their criteria beside both forced on, at poses in shipped worlds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.effects import (
    NO_EFFECT_SETTINGS,
    WORLD_EFFECTS,
    EffectMode,
    EffectSettings,
    name_effect,
)
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.plan.plans import RenderSettings
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import RenderedView, ViewCache
from catoptra_server.render.trace.occlusion.occlusion_cache import light_scene
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from helpers.configs import WORLDS
from helpers.worlds import make_omni_camera

# Within these distances of a start, and heights above its floor.
_REACH_M, _HEIGHTS_M = 3.0, (0.3, 1.2)


@dataclass(frozen=True)
class LeftOut:
    """One pose."""

    decisions: dict[str, EffectDecision]
    """By the name of the effect."""
    largest: float
    """Difference of the picture from the one with both effects, grey levels."""
    visible_share: float
    """Pixels that differ by more than a level, which rounding alone may make."""
    contributions: dict[str, float]
    """By the name of each effect: what the picture loses without it alone, grey levels."""

    def stated(self, name: str) -> float:
        """Grey levels that an effect is stated to change at most."""
        decision = self.decisions[name]
        return decision.bound if decision.change is None else decision.change


def draw_poses(
    world_name: str,
    num_poses: int,
    *,
    max_change: float = 1.0,
    visible_share: float = 1.0,
    width_px: int = 160,
) -> Iterator[LeftOut]:
    """Pictures at random poses, with the light of the world baked whatever its file says."""
    world, _ = read_world(WORLDS / f"{world_name}.ini")
    world = replace(world, light_bake=True)
    lit = light_scene(build_scene(world), world)
    auto = reduce(name_effect, WORLD_EFFECTS, NO_EFFECT_SETTINGS)
    auto = replace(auto, max_change=max_change, visible_share=visible_share)
    names = [one.effect.name for one in auto.settings]
    forced, *alone = (_force(auto, name) for name in ("", *names))
    choice = choose_renderer("trace", lit.scene, lit.world, threads=2, gains=(1.0, 1.0))
    summarizer = SceneSummarizer(lit.scene, lit.world)
    views = ViewCache(RenderPlanner(RendererPool(choice)), summarizer)
    camera = make_omni_camera(width_px=width_px)

    def draw(effects: EffectSettings, state: CameraState) -> RenderedView:
        return views.render(ViewRequest(OmniCameraSpec(camera, RenderSettings(), effects), state))

    generator = np.random.default_rng(7)
    start = np.array(world.starts[0].location_m if world.starts else (0.0, 0.0, 0.0))
    try:
        for _ in range(num_poses):
            x, y = generator.uniform(-_REACH_M, _REACH_M, 2)
            place = start + np.array([x, y, -generator.uniform(*_HEIGHTS_M)])
            pose = Pose.from_rpy(tuple(place), (0.0, 0.0, generator.uniform(-np.pi, np.pi)))
            views_drawn = [draw(effects, CameraState(pose)) for effects in (auto, forced, *alone)]
            chosen, both, *without = (view.image.rgb.astype(np.float64) for view in views_drawn)
            difference = np.abs(chosen - both).max(axis=-1)
            yield LeftOut(
                {decision.effect: decision for decision in views_drawn[0].effect_decisions},
                float(difference.max()),
                float((difference > 1.0).mean()),
                {
                    name: float(np.abs(both - one).max())
                    for name, one in zip(names, without, strict=True)
                },
            )
    finally:
        views.close()


def _force(auto: EffectSettings, left_out: str) -> EffectSettings:
    """The same settings with all effects but one drawn whatever they change."""
    modes = (
        EffectMode.NEVER if one.effect.name == left_out else EffectMode.ALWAYS
        for one in auto.settings
    )
    pairs = zip(auto.settings, modes, strict=True)
    return replace(auto, settings=tuple(replace(one, mode=mode) for one, mode in pairs))
