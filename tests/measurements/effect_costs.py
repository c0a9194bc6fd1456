"""Cost of effects: without any, with all considered and none enabled, and as the scene enables.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/effect_costs.py

Prints, for frames of 640 x 640 px of the field, rendered in turns through `ViewCache` as in the
server, at rest and in motion, the median milliseconds of wall time and of all processors, and the
ratio of the latter to a view without effects. `none enabled` has all kinds in mode auto, with
parameters of a good camera; the second line names the effects that the field enables in any case,
which are in mode never. Decisions: without an enabled effect a view is the plain one
(frames/views.py), not an empty chain of passes; each effect is a pass of its own with a time
of its own, not a part of one fused program.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import cycle

from drive_path import drive_path
from interleaved import median_ms
from scenes import CAMERA_STATE, make_camera, make_worlds

from catoptra_server.effects import (
    EFFECT_TYPES,
    NO_EFFECT_SETTINGS,
    EffectMode,
    EffectSetting,
    EffectSettings,
    EffectType,
)
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import ViewCache
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene

ROUNDS = 60
FEW_ROUNDS = 5
# Parameters with which no effect is enabled in the field, by kind; all others have their defaults,
# and `*` stands for all kinds. They are small, not zero, so that bounds have to be computed.
NEGLIGIBLE_PARAMETERS = {
    "*": {"full_well_e": 1e12, "read_noise_e": 1.0},
    "RollingShutter": {"readout_s": 1e-4},
    "MotionBlur": {"exposure_s": 1e-4},
    "DefocusByDepth": {"f_number": 64.0},
    "Defocus": {"f_number": 64.0},
    "MirrorDust": {"coverage": 0.0, "num_scratches": 0.0},
    "MirrorReflectance": {"refractive_index": 0.01, "extinction_coefficient": 20.0},
    "AutoExposure": {"min_gain": 1.0, "max_gain": 1.0},
    "Blooming": {"overflow_fraction": 0.0},
    "FixedPattern": {"prnu": 0.0, "dsnu_e": 0.0},
    "Quantisation": {"adc_bits": 16.0},
}


def default_settings(mode: EffectMode) -> EffectSettings:
    """All effects with default parameters."""
    effects = (
        kind.factory(**{p.field: p.default for p in kind.parameters})
        for kind in EFFECT_TYPES.values()
    )
    return EffectSettings(tuple(EffectSetting(effect, mode) for effect in effects))


def negligible_setting(kind: EffectType, mode: EffectMode) -> EffectSetting:
    """An effect with the parameters of a good camera."""
    parameters = NEGLIGIBLE_PARAMETERS["*"] | NEGLIGIBLE_PARAMETERS.get(kind.name, {})
    return EffectSetting(
        kind.factory(**{p.field: parameters.get(p.field, p.default) for p in kind.parameters}), mode
    )


def negligible_settings(required: frozenset[str]) -> EffectSettings:
    """All effects in mode auto, without those that are enabled whatever their parameters."""
    modes = (
        (k, EffectMode.NEVER if k.name in required else EffectMode.AUTO)
        for k in EFFECT_TYPES.values()
    )
    return EffectSettings(tuple(negligible_setting(kind, mode) for kind, mode in modes))


def make_renderer(
    renderer: str, samples: int, effects: EffectSettings, camera_states: Iterator[CameraState]
) -> Callable[[], object]:
    """A function that renders the next frame through a view cache of its own."""
    world = make_worlds()["field"]
    scene = build_scene(world)
    choice = choose_renderer(renderer, scene, world)
    views = ViewCache(RenderPlanner(RendererPool(choice)), SceneSummarizer(scene, world))
    spec = OmniCameraSpec(make_camera(), RenderSettings(samples=samples), effects)
    return lambda: views.render(ViewRequest(spec, next(camera_states)))


def find_required_effects() -> frozenset[str]:
    """Effects that the field enables whatever their parameters."""
    frames = make_renderer(
        "trace", 1, negligible_settings(frozenset()), iter(drive_path("field", 40))
    )
    decisions = (d for _ in range(40) for d in frames().effect_decisions)  # type: ignore[attr-defined]
    return frozenset(decision.effect for decision in decisions if decision.enabled)


def main() -> None:
    on = find_required_effects()
    print(f"enabled whatever the parameters, in mode never: {', '.join(sorted(on))}")
    motions = {"at rest": (CAMERA_STATE,), "driving": drive_path("field", 400)}
    for renderer, samples in (("trace", 1), ("trace", 2), ("raster", 1), ("raster", 2)):
        for motion, camera_states in motions.items():
            settings = {
                "none": NO_EFFECT_SETTINGS,
                "none, again": NO_EFFECT_SETTINGS,
                "none enabled": negligible_settings(on),
            }
            draws = {
                k: make_renderer(renderer, samples, w, cycle(camera_states))
                for k, w in settings.items()
            }
            print_times(
                f"{renderer} {samples}x{samples} {motion:<9}", median_ms(draws, rounds=ROUNDS)
            )
        all_run = {
            name: make_renderer(renderer, samples, named, cycle((CAMERA_STATE,)))
            for name, named in {
                "none": NO_EFFECT_SETTINGS,
                "all enabled": default_settings(EffectMode.ALWAYS),
            }.items()
        }
        print_times(
            f"{renderer} {samples}x{samples} at rest  ", median_ms(all_run, rounds=FEW_ROUNDS)
        )


def print_times(label: str, times: dict[str, tuple[float, float]]) -> None:
    """Print a row for each time, with the ratio to the first."""
    first = next(iter(times.values()))[1]
    for name, (wall, processors) in times.items():
        row = f"{name:<18}{wall:8.2f}{processors:8.2f}{processors / first:8.3f}"
        print(f"  {label}{row}", flush=True)


if __name__ == "__main__":
    main()
