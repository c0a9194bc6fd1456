"""What each effect of the real camera adds to a clean picture, in six worlds.

Run: OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests .venv/bin/python tests/measurements/effect_shares.py

Prints processor milliseconds of all threads of a picture of
configs/robots/p2at_omni_real.ini, 640 x 480 px, through `ViewCache` as in the server: the clean
picture, what each effect alone adds, and what all together add, at rest and at 0.5 m/s and
0.5 rad/s, with MaxChange=0.5; what all add with MaxChange=8 and with the robot file's own numbers;
and all effects in mode auto with parameters that call for none, without those that the world needs
even so. With --other and a checkout that has its own environment, both draw in turns, and its
figures follow in brackets: medians of frames that a disturbance meets alike. The image chain alone:
image_chain.py.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from effect_frame_times import make_unneeded_settings

from catoptra_server.commands import explain
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.startup import StartupConfig, read_startup_config
from catoptra_server.effects import EffectMode, EffectSettings
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import ViewCache
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.lit_worlds import make_hall, make_tunnel

MOTIONS = {
    "at rest": explain.ZERO_VELOCITY,
    "moving": explain.PlanarVelocity(0.5, 0.0, 0.5),
}
BUNDLED = {"field": "four_legged_2006"} | {n: n for n in ("corridor", "rescue", "warehouse")}
MADE: dict[str, Callable[[], World]] = {"tunnel": make_tunnel, "hall": make_hall}
WARM_UP = 2
STRICT, LAX = 0.5, 8.0

Draws = dict[tuple[str, str], Callable[[], object]]
Times = dict[str, dict[str, float]]


def read_setup(name: str) -> StartupConfig:
    """The robot with its real camera in a world."""
    robots = [find_configuration("robots", "p2at_omni_real")]
    return read_startup_config(robots, find_configuration("worlds", BUNDLED.get(name, "corridor")))


def make_draws(name: str) -> Draws:
    """Functions that draw one frame, by motion and effect."""
    startup = read_setup(name)
    world = MADE[name]() if name in MADE else startup.world
    scene = build_scene(world) if name in MADE else startup.scene
    pool = RendererPool(choose_renderer("trace", scene, world))
    views = ViewCache(RenderPlanner(pool), SceneSummarizer(scene, world))
    robot, pose = startup.robots[0], PlanarPose(0.3, 0.2, 0.2)
    omni = robot.omni_camera
    assert omni is not None
    if world.starts:
        pose = PlanarPose(*world.starts[0].location_m[:2], world.starts[0].rotation_rad[2])
    named = [s for s in omni.effects.settings if s.mode is not EffectMode.NEVER]
    rows = {"clean": (), **{s.effect.name: (s,) for s in named}, "all": tuple(named)}
    rules = {row: EffectSettings(settings, STRICT) for row, settings in rows.items()}
    rules["all to 8 levels"] = EffectSettings(tuple(named), LAX)
    rules["all as shipped"] = omni.effects
    draws: Draws = {}
    for motion, velocity in MOTIONS.items():
        state = explain.build_camera_state(robot, omni, pose, velocity)

        def request_frame(rule: EffectSettings, state: CameraState = state) -> ViewRequest:
            spec = OmniCameraSpec(omni.camera, omni.render_settings, rule)
            return ViewRequest(spec, state)

        found = views.render(request_frame(make_unneeded_settings(frozenset())))
        needed = frozenset(one.effect for one in found.effect_decisions if one.enabled)
        unneeded = {"none needed": make_unneeded_settings(needed)}
        for row, rule in (rules | unneeded).items():
            request = request_frame(rule)
            draws[motion, row] = lambda request=request: views.render(request)  # type: ignore[misc]
    return draws


def serve_draws(name: str) -> None:
    """Draw each frame once for each line of the input, and print its milliseconds as JSON."""
    draws = make_draws(name)
    for _ in sys.stdin:
        times: Times = {}
        for (motion, row), draw in draws.items():
            begin = time.process_time()
            draw()
            times.setdefault(motion, {})[row] = 1e3 * (time.process_time() - begin)
        print(json.dumps(times), flush=True)


def measure(name: str, checkouts: list[Path], rounds: int) -> list[Times]:
    """Median milliseconds of each checkout, drawn in turns."""
    tests = Path(__file__).parents[1]
    command = [".venv/bin/python", __file__, "--serve", name]
    environment = os.environ | {"PYTHONPATH": str(tests), "OPENBLAS_NUM_THREADS": "1"}
    workers = [
        subprocess.Popen(
            command,
            cwd=c,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for c in checkouts
    ]
    found: list[list[Times]] = [[] for _ in workers]
    for _ in range(WARM_UP + rounds):
        for worker, times in zip(workers, found, strict=True):
            assert worker.stdin is not None
            assert worker.stdout is not None
            print(file=worker.stdin, flush=True)
            times.append(json.loads(worker.stdout.readline()))
    for worker in workers:
        worker.communicate()
    return [
        {
            motion: {
                row: statistics.median(t[motion][row] for t in times[WARM_UP:]) for row in rows
            }
            for motion, rows in times[0].items()
        }
        for times in found
    ]


def print_world(name: str, found: list[Times]) -> None:
    """A row for each effect: what it adds, at rest and moving."""
    print(f"{name:<22}" + "".join(f"{motion:>24}" for motion in MOTIONS))
    for row in found[0]["moving"]:
        cells = []
        for motion in MOTIONS:
            clean = [times[motion]["clean"] if row != "clean" else 0.0 for times in found]
            own = [times[motion][row] - c for times, c in zip(found, clean, strict=True)]
            other = f" ({own[1]:8.2f})" if len(own) > 1 else ""
            cells.append(f"{own[0]:8.2f}{other}")
        print(f"  {row:<20}" + "".join(f"{cell:>24}" for cell in cells), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--other", type=Path, help="a second checkout, drawn in turns")
    parser.add_argument("--world", action="append", choices=[*BUNDLED, *MADE])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--serve", help=argparse.SUPPRESS)
    parsed = parser.parse_args()
    if parsed.serve:
        serve_draws(parsed.serve)
        return
    checkouts = [Path(__file__).parents[2], *([parsed.other] if parsed.other else [])]
    for name in parsed.world or [*BUNDLED, *MADE]:
        print_world(name, measure(name, checkouts, parsed.rounds))


if __name__ == "__main__":
    main()
