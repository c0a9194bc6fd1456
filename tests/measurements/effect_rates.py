"""Rates of effects: what each adds to a frame, in milliseconds per million samples or pixels.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/effect_rates.py

For each engine, frames of the shipped real camera in three worlds, driving, rendered in turns; the
rate of an effect is what its frame takes more than one without it, half the processor time of all
threads as in renderer_comparison.py, over millions of samples for scene effects and of pixels for
the others; medians over the worlds. Image effects are added one by one in optical order to a frame
without scene effects; fog and shutters each to a frame with own body and shadows. Effects that the
shipped camera lacks have the parameters below. Decision: the rates of planning/effect_rates.py.
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable, Mapping
from functools import partial

from interleaved import median_ms

from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_server import explain
from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.config.bundled_files import find_configuration
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.effect import (
    EffectMode,
    EffectSetting,
    EffectSettings,
)
from catoptra_server.effects.effect_plan import apply_scene_effects, plan_effects
from catoptra_server.planning.effect_rates import RenderEngine
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.planning.exposure_budget import limit_time_samples
from catoptra_server.planning.renderer_choice import create_renderer
from catoptra_server.render.renderer import Renderer
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.startup import StartupConfig, read_startup_config

WORLDS = ("four_legged_2006", "corridor", "rescue")
DRIVING = explain.PlanarVelocity(0.6, 0.0, 0.3)
# Per sample, since each is part of what is traced or rasterized; all others are per pixel.
SCENE_EFFECTS = ("SelfView", "Shadows", "RollingShutter", "MotionBlur", "Fog")
# Side of the image and rounds; a frame of the reference with a shutter takes seconds.
SIZES = {
    RenderEngine.KERNEL: (480, 9),
    RenderEngine.SOFTWARE_OPENGL: (480, 3),
    RenderEngine.REFERENCE: (160, 3),
}
PARAMETERS: Mapping[str, Mapping[str, float]] = {
    "RollingShutter": {"readout_s": 0.02},
    "Fog": {"density_per_m": 0.1},
    "Misalignment": {"x_m": 1e-4},
    "ChromaticAberration": {"red_magnification": 1.0005, "blue_magnification": 0.9995},
    "Exposure": {"exposure_s": 0.01},
    "WhiteBalance": {"red_gain": 1.2},
    "Quantisation": {"adc_bits": 10.0},
}


def make_settings(left_out: str) -> tuple[EffectSetting, ...]:
    """All effects but one, in mode auto: the two kinds of defocus exclude each other."""
    settings = []
    for kind in EFFECT_TYPES:
        if kind.name != left_out:
            changes = PARAMETERS.get(kind.name, {})
            fields = {p.field: changes.get(p.field, p.default) for p in kind.parameters}
            settings.append(EffectSetting(kind.factory(**fields), EffectMode.AUTO))
    return tuple(settings)


def make_renderer(engine: RenderEngine, startup: StartupConfig) -> Renderer:
    scene, world = startup.scene, startup.world
    if engine is RenderEngine.SOFTWARE_OPENGL:
        return create_renderer(RendererKind.RASTER, scene, world)
    return TraceRenderer(scene, world, engine=engine.value)  # type: ignore[arg-type]


def measure_rates(engine: RenderEngine, world: str, left_out: str) -> dict[str, float]:
    """Rate of each effect in a world."""
    startup = read_startup_config(
        [find_configuration("robots", "p2at_omni_real")], find_configuration("worlds", world)
    )
    robot, start = startup.robots[0], startup.world.starts[0]
    assert robot.omni_camera is not None
    side_px, rounds = SIZES[engine]
    mirror = robot.omni_camera.camera
    camera: OmniCamera = camera_with_inscribed_rim(
        mirror.mirror, width_px=side_px, height_px=side_px, rim_rad=mirror.rim_rad
    )
    pose = PlanarPose(*start.location_m[:2], start.rotation_rad[2])
    state = explain.build_camera_state(robot, robot.omni_camera, pose, DRIVING)
    is_raster = engine is RenderEngine.SOFTWARE_OPENGL
    kind = RendererKind.RASTER if is_raster else RendererKind.TRACE
    plan = plan_from_settings(RenderSettings(samples=2), camera, kind=kind, reason="measured")
    renderer = make_renderer(engine, startup)
    view = renderer.prepare(camera, plan)
    summary = SceneSummarizer(startup.scene, startup.world).summarize(state, camera)
    settings = {one.effect.name: one for one in make_settings(left_out)}
    pairs = pair_up(settings)
    draws: dict[str, Callable[[], object]] = {}
    for names in {names: None for pair in pairs.values() for names in pair}:
        named = EffectSettings(tuple(settings[name] for name in names))
        effects = plan_effects(named, summary, camera)
        changed = limit_time_samples(apply_scene_effects(state, effects), camera, plan)
        draws[" ".join(names)] = partial(
            view.render, changed, effects.image_effects, effects.thresholds
        )
    frame_ms = {name: 0.5 * ms for name, (_, ms) in median_ms(draws, rounds=rounds).items()}
    renderer.close()
    rates = {}
    for name, (before, after) in pairs.items():
        per_pixel = plan.samples**2 if name in SCENE_EFFECTS else 1
        added_ms = frame_ms[" ".join(after)] - frame_ms[" ".join(before)]
        rates[name] = added_ms / (1e-6 * side_px**2 * per_pixel)
    return rates


def pair_up(
    settings: Mapping[str, EffectSetting],
) -> dict[str, tuple[tuple[str, ...], tuple[str, ...]]]:
    """Names of the effects of a frame without and of one with each effect."""
    pairs: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {}
    still, image = ("SelfView", "Shadows"), ()
    for name in settings:
        if name in still:
            before = still[: still.index(name)]
            pairs[name] = before, (*before, name)
        elif name in SCENE_EFFECTS:
            pairs[name] = still, (*still, name)
        else:
            pairs[name] = image, (*image, name)
            image = (*image, name)
    return pairs


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--engine", action="append", choices=[one.value for one in RenderEngine])
    wanted = parser.parse_args().engine or [one.value for one in RenderEngine]
    for engine in map(RenderEngine, wanted):
        worlds = WORLDS[:1] if engine is RenderEngine.REFERENCE else WORLDS
        found = [measure_rates(engine, world, "DefocusByDepth") for world in worlds]
        by_depth = measure_rates(engine, worlds[0], "Defocus")["DefocusByDepth"]
        print(f"RenderEngine.{engine.name}: {{")
        for kind in EFFECT_TYPES:
            values = (
                [by_depth] if kind.name == "DefocusByDepth" else [one[kind.name] for one in found]
            )
            rate = max(statistics.median(values), 0.0)
            print(f'    "{kind.name}": {rate:.3g},  # {", ".join(f"{v:.3g}" for v in values)}')
        print("},", flush=True)


if __name__ == "__main__":
    main()
