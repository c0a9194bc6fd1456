"""`catoptra-server explain`: which effects a robot's camera needs in a world, why, at what cost.

The decision is the one that the server takes; the milliseconds are medians of frames drawn here.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from statistics import median

from catoptra_protocol.errors import CatoptraError
from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.config.bundled_files import find_configuration
from catoptra_server.effects.effect_plan import EffectDecision, format_decisions
from catoptra_server.frames.frame_request import ViewRequest
from catoptra_server.frames.view_cache import ViewCache
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.planning.renderer_choice import choose_renderer
from catoptra_server.render.render_plan import requested_samples
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.robot_description import OmniCameraDescription, RobotDescription
from catoptra_server.scene.dynamic_object import DynamicObject
from catoptra_server.scene.twist import Twist
from catoptra_server.simulation.robot_meshes import build_ego_mesh
from catoptra_server.startup import StartupConfig, read_startup_config

EXIT_FAILURE = 2
# A median of few is enough: what is told is which effect costs, not how much to a tenth.
_NUM_FRAMES = 5


@dataclass(frozen=True, slots=True)
class PlanarVelocity:
    """How a robot drives, in its own axes: ahead, to its right; clockwise seen from above."""

    forward_m_s: float = 0.0
    right_m_s: float = 0.0
    yaw_rate_rad_s: float = 0.0

    @property
    def twist(self) -> Twist:
        """Return it as a motion of the robot's frame, told at its origin in its own axes."""
        return Twist((self.forward_m_s, self.right_m_s, 0.0), (0.0, 0.0, self.yaw_rate_rad_s))


ZERO_VELOCITY = PlanarVelocity()


@dataclass(frozen=True, slots=True)
class CameraEffectReport:
    """What was decided for one camera.

    ms: by effect that runs; what changes the scene takes its time in the stages of the drawing.
    others_ms: those, and all others.
    """

    robot: str
    camera: str
    plan: str
    effects: tuple[EffectDecision, ...]
    effect_ms: dict[str, float]
    other_ms: float

    def __str__(self) -> str:
        whole = self.other_ms + sum(self.effect_ms.values())
        head = f"{self.robot} {self.camera}: {self.plan}"
        cost = f"a frame takes {whole:.1f} ms, {sum(self.effect_ms.values()):.1f} of it for effects"
        return "\n".join((head, format_decisions(self.effects, self.effect_ms), cost))


def main(arguments: Sequence[str]) -> int:
    """Explain; return 0, or 2 with a message if it could not be done."""
    parsed = _build_parser().parse_args(arguments)
    try:
        setup = read_startup_config(
            [find_configuration("robots", parsed.robot)], find_configuration("worlds", parsed.world)
        )
        explained = [
            *explain_cameras(
                setup, renderer=parsed.renderer, pose=parsed.pose, velocity=parsed.velocity
            )
        ]
    except CatoptraError as error:
        print(f"catoptra-server explain: {error}", file=sys.stderr)
        return EXIT_FAILURE
    if parsed.json:
        print(json.dumps([asdict(one) for one in explained], indent=2))
    else:
        print("\n\n".join(map(str, explained)) or "no robot has an omnidirectional camera")
    return 0


def explain_cameras(
    setup: StartupConfig,
    *,
    renderer: str,
    pose: PlanarPose | None = None,
    velocity: PlanarVelocity = ZERO_VELOCITY,
) -> Iterator[CameraEffectReport]:
    """Yield what was decided for each class's camera, drawn where a robot starts, or at a place."""
    for robot in setup.robots:
        if robot.omni_camera is not None:
            exposure = build_camera_state(
                robot, robot.omni_camera, pose or _start_pose(setup), velocity
            )
            yield _explain_camera(setup, robot, robot.omni_camera, renderer, exposure)


def build_camera_state(
    robot: RobotDescription, omni: OmniCameraDescription, pose: PlanarPose, velocity: PlanarVelocity
) -> CameraState:
    """Return the exposure of a robot's camera at a place, while the robot drives."""
    base = pose.at_height(robot.drive.ride_height_m)
    mirror = base @ omni.robot_from_mirror
    twist = velocity.twist.rotate(base.rotation)
    mesh = build_ego_mesh(robot)
    return CameraState(
        mirror,
        twist=twist.at_offset(mirror.translation - base.translation),
        ego_body=DynamicObject(mesh, base, twist) if mesh is not None else None,
    )


def _explain_camera(
    startup_files: StartupConfig,
    robot: RobotDescription,
    omni: OmniCameraDescription,
    renderer: str,
    camera_state: CameraState,
) -> CameraEffectReport:
    samples = requested_samples(omni.render_settings)
    choice = choose_renderer(renderer, startup_files.scene, startup_files.world, samples=samples)
    views = ViewCache(RenderPlanner(choice), SceneSummarizer(setup.scene, setup.world))
    eye = OmniCameraSpec(omni.camera, omni.render_settings, omni.effects)
    drawn = [views.render(ViewRequest(eye, camera_state)) for _ in range(_NUM_FRAMES)]
    plan = str(views.plan(eye))
    views.close()
    stages = {name: median(one.stage_ms[name] for one in drawn) for name in drawn[0].stage_ms}
    running = {d.effect: stages.pop(d.effect) for d in drawn[0].effects if d.effect in stages}
    others_ms = sum(stages.values())
    return CameraEffectReport(
        robot.class_name, omni.name, plan, drawn[0].effects, running, others_ms
    )


def _start_pose(setup: StartupConfig) -> PlanarPose:
    """Return the first start place of the world, its middle if it has none."""
    for start in setup.world.starts:
        return PlanarPose(start.location_m[0], start.location_m[1], start.rotation_rad[2])
    return PlanarPose(0.0, 0.0, 0.0)


def _build_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="catoptra-server explain",
        description="Tell which effects a robot's camera needs in a world, why, at what cost.",
    )
    add = parser.add_argument
    add("--robot", required=True, metavar="FILE", help="robot ini, or the name of a shipped one")
    add("--world", required=True, metavar="FILE", help="world ini, or the name of a shipped one")
    add("--renderer", choices=["auto", "trace", "raster"], default="auto")
    add("--pose", type=_parse_pose, metavar="X,Y,YAW",
        help="from where it is drawn, in metres and radians; default: the first start")  # fmt: skip
    add("--velocity", type=_parse_velocity, metavar="VX,VY,YAWRATE", default=ZERO_VELOCITY,
        help="how the robot moves while it is drawn: metres a second ahead and to its right, "
             "radians a second clockwise from above; default: it stands")  # fmt: skip
    add("--json", action="store_true", help="print JSON")
    return parser


def _parse_pose(text: str) -> PlanarPose:
    return PlanarPose(*_parse_three_floats(text, "a pose is three numbers X,Y,YAW"))


def _parse_velocity(text: str) -> PlanarVelocity:
    return PlanarVelocity(*_parse_three_floats(text, "a velocity is three numbers VX,VY,YAWRATE"))


def _parse_three_floats(text: str, expected: str) -> tuple[float, float, float]:
    """Return three finite numbers with commas between them."""
    try:
        x, y, turn = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{expected}, not {text!r}") from None
    if not all(map(math.isfinite, (x, y, turn))):
        raise argparse.ArgumentTypeError(f"{expected}, not {text!r}")
    return x, y, turn
