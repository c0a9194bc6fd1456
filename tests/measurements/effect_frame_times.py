"""Frame times of effects: each beside a clean frame, and the whole real camera.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/effect_frame_times.py

Prints, for frames of 640 x 640 px at 2 x 2 samples of the field, rendered in turns through
`ViewCache` as in the server, the median milliseconds of wall time and of all processors, and what
an effect adds to a clean frame: the robot drives at 1 m/s and turns at 0.5 rad/s. Then the shipped
real camera at 640 x 480 px, at rest and in that motion, in three worlds, with frames a second. Then
all effects in mode auto with parameters that call for none, beside frames without any. The options
select renderers and a part; software OpenGL takes seconds for some rows.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace

from effect_costs import NEGLIGIBLE_PARAMETERS
from interleaved import median_ms
from scenes import make_camera

from catoptra_server.commands import explain
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.startup import StartupConfig, read_startup_config
from catoptra_server.effects import (
    EFFECT_TYPES,
    NO_EFFECT_SETTINGS,
    EffectMode,
    EffectSetting,
    EffectSettings,
)
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import ViewCache
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.world.objects import CameraState

DRIVING = explain.PlanarVelocity(1.0, 0.0, 0.5)
ROWS: dict[str, tuple[str, ...]] = {
    "clean": (),
    "own body and shadows": ("SelfView", "Shadows"),
    "fog": ("Fog",),
    "defocus": ("Defocus",),
    "rolling shutter": ("RollingShutter",),
    "motion blur": ("MotionBlur",),
}
# Where defaults make an effect negligible, or differ from the real camera's.
PARAMETERS = {
    "Fog": {"density_per_m": 0.1},
    "RollingShutter": {"readout_s": 1.0 / 30.0},
    "MotionBlur": {"exposure_s": 1.0 / 60.0},
    "Defocus": {"f_number": 4.0},
}
# Parameters with which no effect is needed, in grey levels: small and not zero where that is enough
# for a proof, so that bounds have to be computed.
UNNEEDED_PARAMETERS = NEGLIGIBLE_PARAMETERS | {
    "DefocusByDepth": {"f_number": 64.0, "pixel_pitch_m": 1e-7},
    "Defocus": {"f_number": 64.0, "pixel_pitch_m": 1e-7},
    "Diffraction": {"f_number": 0.7, "pixel_pitch_m": 2e-5},
}


def make_settings(names: tuple[str, ...], mode: EffectMode = EffectMode.AUTO) -> EffectSettings:
    """Named effects with the parameters of this comparison."""
    settings = []
    for kind in EFFECT_TYPES.values():
        values = {p.field: p.default for p in kind.parameters}
        values |= {k: v for k, v in PARAMETERS.get(kind.name, {}).items() if k in values}
        if kind.name in names:
            settings.append(EffectSetting(kind.factory(**values), mode))
    return EffectSettings(tuple(settings))


def make_unneeded_settings(summary_names: frozenset[str]) -> EffectSettings:
    """All effects in mode auto with negligible parameters, without those that a scene needs."""
    settings = []
    for kind in EFFECT_TYPES.values():
        own = UNNEEDED_PARAMETERS["*"] | UNNEEDED_PARAMETERS.get(kind.name, {})
        effect = kind.factory(**{p.field: own.get(p.field, p.default) for p in kind.parameters})
        mode = EffectMode.NEVER if kind.name in summary_names else EffectMode.AUTO
        settings.append(EffectSetting(effect, mode))
    return EffectSettings(tuple(settings))


class Bench:
    """One world and robot, rendered through the server's own view cache."""

    def __init__(self, world: str, renderer: str, *, is_occluded: bool = True) -> None:
        self.startup: StartupConfig = read_startup_config(
            [find_configuration("robots", "p2at_omni_real")], find_configuration("worlds", world)
        )
        if not is_occluded:
            scene = replace(self.startup.scene, occlusion=None)
            self.startup = replace(self.startup, scene=scene)
        choice = choose_renderer(renderer, self.startup.scene, self.startup.world)
        summarizer = SceneSummarizer(self.startup.scene, self.startup.world)
        self.views = ViewCache(RenderPlanner(RendererPool(choice)), summarizer)
        self.robot = self.startup.robots[0]

    def state(self, velocity: explain.PlanarVelocity) -> CameraState:
        """State of the robot's camera at the world's first start pose."""
        omni, starts = self.robot.omni_camera, self.startup.world.starts
        assert omni is not None
        pose = PlanarPose(0.0, 0.0, 0.0)
        if starts:
            pose = PlanarPose(*starts[0].location_m[:2], starts[0].rotation_rad[2])
        return explain.build_camera_state(self.robot, omni, pose, velocity)

    def make_draw(
        self, effects: EffectSettings, velocity: explain.PlanarVelocity
    ) -> Callable[[], object]:
        """Function that renders 640 x 640 px at 2 x 2 samples."""
        spec = OmniCameraSpec(make_camera(640), RenderSettings(samples=2), effects)
        request = ViewRequest(spec, self.state(velocity))
        return lambda: self.views.render(request)

    def make_real_draw(self, velocity: explain.PlanarVelocity) -> Callable[[], object]:
        """Function that renders the shipped real camera."""
        omni = self.robot.omni_camera
        assert omni is not None
        spec = OmniCameraSpec(omni.camera, omni.render_settings, omni.effects)
        request = ViewRequest(spec, self.state(velocity))
        return lambda: self.views.render(request)

    def find_needed(self) -> frozenset[str]:
        """Effects that are enabled even with negligible parameters."""
        draw = self.make_draw(make_unneeded_settings(frozenset()), explain.ZERO_VELOCITY)
        decisions = draw().effect_decisions  # type: ignore[attr-defined]
        return frozenset(one.effect for one in decisions if one.enabled)


def print_rows(label: str, times: dict[str, tuple[float, float]]) -> None:
    """Print wall and processor milliseconds, and what a row adds to the first."""
    first = next(iter(times.values()))[1]
    for name, (wall, processors) in times.items():
        added, rate = processors - first, 1e3 / wall
        print(
            f"{label:<8}{name:<34}{wall:9.2f}{processors:10.2f}{added:+10.2f}{rate:8.1f}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--renderer", action="append", choices=["trace", "raster"])
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--part", action="append", choices=["rows", "real", "unneeded"])
    parsed = parser.parse_args()
    parts = parsed.part or ["rows", "real", "unneeded"]
    print(f"{'':<42}{'wall ms':>9}{'processor':>10}{'added':>10}{'1/s':>8}")
    for renderer in parsed.renderer or ["trace", "raster"]:
        rounds = parsed.rounds if renderer == "trace" else max(parsed.rounds // 5, 3)
        if "rows" in parts:
            bench = Bench("four_legged_2006", renderer)
            draws = {
                name: bench.make_draw(make_settings(names), DRIVING) for name, names in ROWS.items()
            }
            print_rows(renderer, median_ms(draws, rounds=rounds))
            bench.views.close()
        for world in ("four_legged_2006", "corridor", "rescue") if "real" in parts else ():
            bench = Bench(world, renderer)
            draws = {
                f"real camera, {world}, at rest": bench.make_real_draw(explain.ZERO_VELOCITY),
                f"real camera, {world}, moving": bench.make_real_draw(DRIVING),
            }
            print_rows(renderer, median_ms(draws, rounds=rounds))
            bench.views.close()
        if "unneeded" in parts:
            bench = Bench("four_legged_2006", renderer)
            unneeded = make_unneeded_settings(bench.find_needed())
            draws = {
                "no effect named": bench.make_draw(NO_EFFECT_SETTINGS, explain.ZERO_VELOCITY),
                "all auto, none needed": bench.make_draw(unneeded, explain.ZERO_VELOCITY),
                "no effect named, again": bench.make_draw(
                    NO_EFFECT_SETTINGS, explain.ZERO_VELOCITY
                ),
            }
            print_rows(renderer, median_ms(draws, rounds=4 * rounds))
            bench.views.close()


if __name__ == "__main__":
    main()
