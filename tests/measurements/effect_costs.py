"""What do effects cost: none that is named, all where none is needed, and all that are called for?

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/effect_costs.py

Prints, for frames of 640 x 640 px of the field, drawn in turns through `ViewCache` as the server draws
them, standing and driving, the median milliseconds on the wall and of all processors, and the ratio
of the latter to the view that knows of no effects. `none needed` names all kinds that there are, on
auto, with numbers of a good camera; what the criterion calls for all the same is named by the
second line, and left out by `never`. Decided by it: effects that are not called for leave the usual
view in place (frames/view_cache.py) instead of a chain without links; each effect is a pass of its own,
whose time is known, instead of one fused program.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import cycle

from drive_path import drive_path
from interleaved import median_ms
from scenes import CAMERA_STATE, make_camera, make_worlds

from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.effect import (
    NO_EFFECT_SETTINGS,
    EffectMode,
    EffectSetting,
    EffectSettings,
    EffectType,
)
from catoptra_server.frames.frame_request import ViewRequest
from catoptra_server.frames.view_cache import ViewCache
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.planning.renderer_choice import choose_renderer
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.scene.scene_mesh import build_scene

ROUNDS = 60
FEW_ROUNDS = 5
# Numbers with which no effect is needed in the field, by kind; those of every other field are the
# defaults, and `*` stands for all kinds. They are small, not nothing: bounds have to be found.
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
    """Return all effects with their defaults."""
    effects = (
        kind.factory(**{p.field: p.default for p in kind.parameters}) for kind in EFFECT_TYPES
    )
    return EffectSettings(tuple(EffectSetting(effect, mode) for effect in effects))


def negligible_setting(kind: EffectType, mode: EffectMode) -> EffectSetting:
    """Return an effect with the numbers of a good camera."""
    numbers = NEGLIGIBLE_PARAMETERS["*"] | NEGLIGIBLE_PARAMETERS.get(kind.name, {})
    return EffectSetting(
        kind.factory(**{p.field: numbers.get(p.field, p.default) for p in kind.parameters}), mode
    )


def negligible_settings(required: frozenset[str]) -> EffectSettings:
    """Return all effects on auto, but for those that are called for whatever their numbers."""
    modes = ((k, EffectMode.NEVER if k.name in required else EffectMode.AUTO) for k in EFFECT_TYPES)
    return EffectSettings(tuple(negligible_setting(kind, mode) for kind, mode in modes))


def make_renderer(
    renderer: str, samples: int, effects: EffectSettings, camera_states: Iterator[CameraState]
) -> Callable[[], object]:
    """Return what draws frames through views of their own."""
    world = make_worlds()["field"]
    scene = build_scene(world)
    choice = choose_renderer(renderer, scene, world, samples=samples)
    views = ViewCache(RenderPlanner(choice), SceneSummarizer(scene, world))
    eye = OmniCameraSpec(make_camera(), RenderSettings(samples=samples), effects)
    return lambda: views.render(ViewRequest(eye, next(camera_states)))


def find_required_effects() -> frozenset[str]:
    """Return what the field calls for, whatever the numbers."""
    frames = make_renderer(
        "trace", 1, negligible_settings(frozenset()), iter(drive_path("field", 40))
    )
    decisions = (one for _ in range(40) for one in frames().effects)  # type: ignore[attr-defined]
    return frozenset(one.effect for one in decisions if one.enabled)


def main() -> None:
    on = find_required_effects()
    print(f"called for whatever the numbers, left out by `never`: {', '.join(sorted(on))}")
    ways = {"standing": (CAMERA_STATE,), "driving": drive_path("field", 400)}
    for renderer, samples in (("trace", 1), ("trace", 2), ("raster", 1), ("raster", 2)):
        for way, exposures in ways.items():
            named = {
                "none named": NO_EFFECT_SETTINGS,
                "none named, again": NO_EFFECT_SETTINGS,
                "none needed": negligible_settings(on),
            }
            draws = {
                k: make_renderer(renderer, samples, w, cycle(exposures)) for k, w in named.items()
            }
            print_times(f"{renderer} {samples}x{samples} {way:<9}", median_ms(draws, rounds=ROUNDS))
        all_run = {
            name: make_renderer(renderer, samples, named, cycle((CAMERA_STATE,)))
            for name, named in {
                "none named": NO_EFFECT_SETTINGS,
                "all run": default_settings(EffectMode.ALWAYS),
            }.items()
        }
        print_times(
            f"{renderer} {samples}x{samples} standing ", median_ms(all_run, rounds=FEW_ROUNDS)
        )


def print_times(label: str, times: dict[str, tuple[float, float]]) -> None:
    """Print a row each, with the ratio to the first."""
    first = next(iter(times.values()))[1]
    for name, (wall, processors) in times.items():
        row = f"{name:<18}{wall:8.2f}{processors:8.2f}{processors / first:8.3f}"
        print(f"  {label}{row}", flush=True)


if __name__ == "__main__":
    main()
