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
from catoptra_server.config.shipped import configuration_file
from catoptra_server.effects.decide import Decision, table
from catoptra_server.imaging.planning import Planning
from catoptra_server.imaging.shot import OmniEye, Take
from catoptra_server.imaging.views import Views
from catoptra_server.plan.render_plan import wished_samples
from catoptra_server.render.choice import choose_renderer
from catoptra_server.render.renderer import Exposure
from catoptra_server.robot.description import OmniCameraDescription, RobotDescription
from catoptra_server.robot.pose import PlanarPose
from catoptra_server.scene.bodies import Body
from catoptra_server.scene.motion import Twist
from catoptra_server.setup import Setup, read_setup
from catoptra_server.simulation.appearance import own_mesh

EXIT_CANNOT_EXPLAIN = 2
# A median of few is enough: what is told is which effect costs, not how much to a tenth.
_FRAMES = 5


@dataclass(frozen=True, slots=True)
class Velocity:
    """How a robot drives, in its own axes: ahead, to its right; clockwise seen from above."""

    ahead_m_s: float = 0.0
    right_m_s: float = 0.0
    yaw_rate_rad_s: float = 0.0

    @property
    def twist(self) -> Twist:
        """Return it as a motion of the robot's frame, told at its origin in its own axes."""
        return Twist((self.ahead_m_s, self.right_m_s, 0.0), (0.0, 0.0, self.yaw_rate_rad_s))


STANDING = Velocity()


@dataclass(frozen=True, slots=True)
class Explained:
    """What was decided for one camera.

    ms: by effect that runs; what changes the scene takes its time in the stages of the drawing.
    others_ms: those, and all others.
    """

    robot: str
    camera: str
    plan: str
    effects: tuple[Decision, ...]
    ms: dict[str, float]
    others_ms: float

    def __str__(self) -> str:
        whole = self.others_ms + sum(self.ms.values())
        head = f"{self.robot} {self.camera}: {self.plan}"
        cost = f"a frame takes {whole:.1f} ms, {sum(self.ms.values()):.1f} of it for effects"
        return "\n".join((head, table(self.effects, self.ms), cost))


def main(arguments: Sequence[str]) -> int:
    """Explain; return 0, or 2 with a message if it could not be done."""
    parsed = _parser().parse_args(arguments)
    try:
        setup = read_setup(
            [configuration_file("robots", parsed.robot)], configuration_file("worlds", parsed.world)
        )
        explained = [
            *explanations(
                setup, renderer=parsed.renderer, place=parsed.pose, velocity=parsed.velocity
            )
        ]
    except CatoptraError as error:
        print(f"catoptra-server explain: {error}", file=sys.stderr)
        return EXIT_CANNOT_EXPLAIN
    if parsed.json:
        print(json.dumps([asdict(one) for one in explained], indent=2))
    else:
        print("\n\n".join(map(str, explained)) or "no robot has an omnidirectional camera")
    return 0


def explanations(
    setup: Setup,
    *,
    renderer: str,
    place: PlanarPose | None = None,
    velocity: Velocity = STANDING,
) -> Iterator[Explained]:
    """Yield what was decided for each class's camera, drawn where a robot starts, or at a place."""
    for robot in setup.robots:
        if robot.omni_camera is not None:
            exposure = exposed(robot, robot.omni_camera, place or _start(setup), velocity)
            yield _explained(setup, robot, robot.omni_camera, renderer, exposure)


def exposed(
    robot: RobotDescription, omni: OmniCameraDescription, place: PlanarPose, velocity: Velocity
) -> Exposure:
    """Return the exposure of a robot's camera at a place, while the robot drives."""
    base = place.at_height(robot.drive.ride_height_m)
    mirror = base @ omni.robot_from_mirror
    twist = velocity.twist.turned(base.rotation)
    mesh = own_mesh(robot)
    return Exposure(
        mirror,
        twist=twist.at(mirror.translation - base.translation),
        own_body=Body(mesh, base, twist) if mesh is not None else None,
    )


def _explained(
    setup: Setup,
    robot: RobotDescription,
    omni: OmniCameraDescription,
    renderer: str,
    exposure: Exposure,
) -> Explained:
    samples = wished_samples(omni.wish)
    choice = choose_renderer(renderer, setup.scene, setup.world, samples=samples)
    views = Views(Planning(choice))
    eye = OmniEye(omni.camera, omni.wish, omni.effects)
    drawn = [views.draw(Take(eye, exposure)) for _ in range(_FRAMES)]
    plan = str(views.plan(eye))
    views.close()
    stages = {name: median(one.stage_ms[name] for one in drawn) for name in drawn[0].stage_ms}
    running = {d.effect: stages.pop(d.effect) for d in drawn[0].effects if d.effect in stages}
    others_ms = sum(stages.values())
    return Explained(robot.class_name, omni.name, plan, drawn[0].effects, running, others_ms)


def _start(setup: Setup) -> PlanarPose:
    """Return the first start place of the world, its middle if it has none."""
    for start in setup.world.starts:
        return PlanarPose(start.location_m[0], start.location_m[1], start.rotation_rad[2])
    return PlanarPose(0.0, 0.0, 0.0)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="catoptra-server explain",
        description="Tell which effects a robot's camera needs in a world, why, at what cost.",
    )
    add = parser.add_argument
    add("--robot", required=True, metavar="FILE", help="robot ini, or the name of a shipped one")
    add("--world", required=True, metavar="FILE", help="world ini, or the name of a shipped one")
    add("--renderer", choices=["auto", "trace", "raster"], default="auto")
    add("--pose", type=_pose, metavar="X,Y,YAW",
        help="from where it is drawn, in metres and radians; default: the first start")  # fmt: skip
    add("--velocity", type=_velocity, metavar="VX,VY,YAWRATE", default=STANDING,
        help="how the robot moves while it is drawn: metres a second ahead and to its right, "
             "radians a second clockwise from above; default: it stands")  # fmt: skip
    add("--json", action="store_true", help="print JSON")
    return parser


def _pose(text: str) -> PlanarPose:
    return PlanarPose(*_three(text, "a pose is three numbers X,Y,YAW"))


def _velocity(text: str) -> Velocity:
    return Velocity(*_three(text, "a velocity is three numbers VX,VY,YAWRATE"))


def _three(text: str, expected: str) -> tuple[float, float, float]:
    """Return three finite numbers with commas between them."""
    try:
        x, y, turn = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{expected}, not {text!r}") from None
    if not all(map(math.isfinite, (x, y, turn))):
        raise argparse.ArgumentTypeError(f"{expected}, not {text!r}")
    return x, y, turn
