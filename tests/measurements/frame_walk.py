"""Files that a frame passes through: how many, in how many calls, with how many changes of file.

Run: .venv/bin/python tests/measurements/frame_walk.py [--robot NAME] [--calls]

One view of a bundled robot in the field is rendered through the server's own views, the first frame
and a steady one; calls of the server's functions are counted by a profile function. A reader who
follows a frame opens these files. Comprehensions and properties count as their function's file.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from types import FrameType

import catoptra_server
from catoptra_server.commands.explain import ZERO_VELOCITY, build_camera_state
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.startup import read_startup_config
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import ViewCache
from catoptra_server.simulation.robot_description import PlanarPose

ROOT = Path(catoptra_server.__file__).parent
# What decides: calls into these from any other file are entries into planning.
PLANNING = ("frames/frame_plan.py", "frames/plan/")


def record_calls(work: Callable[[], object]) -> list[tuple[str, str, str]]:
    """Calls of the server's functions, in order: file, function, file of the caller."""
    calls: list[tuple[str, str, str]] = []

    def note(frame: FrameType, event: str, _: object) -> None:
        file = _file_of(frame)
        if event == "call" and file and not frame.f_code.co_name.startswith("<"):
            calls.append((file, frame.f_code.co_name, _file_of(frame.f_back)))

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return calls


def _file_of(frame: FrameType | None) -> str:
    """File of a frame below the server's package; empty for any other."""
    path = "" if frame is None else frame.f_code.co_filename
    return path.removeprefix(f"{ROOT}/") if path.startswith(str(ROOT)) else ""


def describe(title: str, calls: list[tuple[str, str, str]]) -> str:
    """Numbers of a walk, in words."""
    files = [file for file, _, _ in calls]
    changes = sum(one != other for one, other in pairwise(files))
    entries = {
        function
        for file, function, caller in calls
        if file.startswith(PLANNING) and not caller.startswith(PLANNING)
    }
    return (
        f"{title}: {len(set(files))} files, {len(calls)} calls, {changes} changes of file; "
        f"planning entered by {', '.join(sorted(entries))}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", default="p2at_omni")
    parser.add_argument("--calls", action="store_true", help="print the calls of the steady frame")
    parsed = parser.parse_args()
    startup = read_startup_config(
        [find_configuration("robots", parsed.robot)],
        find_configuration("worlds", "four_legged_2006"),
    )
    choice = choose_renderer("trace", startup.scene, startup.world)
    views = ViewCache(
        RenderPlanner(RendererPool(choice)), SceneSummarizer(startup.scene, startup.world)
    )
    robot = startup.robots[0]
    omni = robot.omni_cameras[0]
    spec = OmniCameraSpec(omni.camera, omni.render_settings, omni.effects)

    state = build_camera_state(robot, omni, PlanarPose(0.0, 0.2, 0.4), ZERO_VELOCITY)
    request = ViewRequest(spec, state)
    print(describe("first frame", record_calls(lambda: views.render(request))))
    for _ in range(20):
        views.render(request)
    steady = record_calls(lambda: views.render(request))
    print(describe("steady frame", steady))
    if parsed.calls:
        for file, function, _ in steady:
            print(f"  {file}:{function}")


if __name__ == "__main__":
    main()
