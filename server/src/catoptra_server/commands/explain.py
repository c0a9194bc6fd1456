"""`catoptra-server explain`: effects that a robot's cameras need in a world, and their cost.

The decisions are the server's own; the milliseconds are medians of frames rendered here. Effects
with a stage of their own take that stage's time. All others change what the renderer traces or
rasterizes: their time is the difference between frames with and without. Effects are added in
optical order, so that all times and the rest add up to the frame.
"""

from __future__ import annotations

import argparse
import json
import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from statistics import median

from catoptra_protocol.command_line import CommandParser
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.startup import (
    StartupConfig,
    create_ray_caster,
    make_start_states,
    read_startup_config,
)
from catoptra_server.effects import DecisionBasis, EffectMode, EffectSettings, widest_gains
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import EffectDecision, format_decisions
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.image_port import mounted_camera_state
from catoptra_server.frames.plan.camera import (
    CameraSpec,
    OmniCameraSpec,
    explain_viewpoint,
    shows_ego_body,
)
from catoptra_server.frames.plan.costs import CostCache
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import RenderedView, ViewCache
from catoptra_server.render.renderer_kind import AUTO, RENDERER_NAMES
from catoptra_server.runtime.array_cache import find_cache_folder
from catoptra_server.simulation.collision_index import CollisionIndex
from catoptra_server.simulation.ground import NoStandError
from catoptra_server.simulation.robot_bodies import build_ego_mesh
from catoptra_server.simulation.robot_description import (
    OmniCameraDescription,
    PlanarPose,
    RobotDescription,
)
from catoptra_server.simulation.sensors.perspective_camera import PerspectiveCameraSensor
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_server.world.world_description import Twist

log = logging.getLogger(__name__)

# Of each kind of frame, by turns; the first prepares the view and fills caches.
_NUM_FRAMES = 9
_WARM_UP = 2


@dataclass(frozen=True, slots=True)
class PlanarVelocity:
    """Velocity of a robot in its own axes."""

    forward_m_s: float = 0.0
    right_m_s: float = 0.0
    """Sideways, to the robot's right."""
    yaw_rate_rad_s: float = 0.0
    """Clockwise seen from above."""

    @property
    def twist(self) -> Twist:
        """Same motion as a twist of the robot's frame, in the robot's axes."""
        return Twist((self.forward_m_s, self.right_m_s, 0.0), (0.0, 0.0, self.yaw_rate_rad_s))


ZERO_VELOCITY = PlanarVelocity()


def main(arguments: Sequence[str]) -> int:
    """Run the command."""
    parsed = _build_parser().parse_args(arguments)
    startup = read_startup_config([parsed.robot], parsed.world)
    reports = [
        report for robot in startup.robots for report in _explain_robot(startup, robot, parsed)
    ]
    if parsed.json:
        print(json.dumps([asdict(report) for report in reports], indent=2))
    else:
        print("\n\n".join(map(str, reports)) or "no robot has a camera")
    return 0


def _build_parser() -> CommandParser:
    parser = CommandParser(
        "catoptra-server explain",
        "Report the effects that a robot's cameras need in a world, with their cost.",
    )
    add = parser.add_argument
    add("--robot", required=True, type=partial(find_configuration, "robots"), metavar="FILE",
        help="robot ini, or the name of a bundled one")  # fmt: skip
    add("--world", required=True, type=partial(find_configuration, "worlds"), metavar="FILE",
        help="world ini, or the name of a bundled one")  # fmt: skip
    add("--renderer", choices=RENDERER_NAMES, default=AUTO, help="renderer of the frames")
    add("--pose", type=parse_pose, metavar="X,Y,YAW",
        help="robot's pose, in metres and radians (default: the first start pose)")  # fmt: skip
    add("--velocity", type=_parse_velocity, metavar="VX,VY,YAWRATE", default=ZERO_VELOCITY,
        help="velocity of the robot during the exposure: metres a second ahead and to the right, "
             "radians a second clockwise from above (default: at rest)")  # fmt: skip
    add("--json", action="store_true", help="print JSON")
    return parser


def parse_pose(text: str) -> PlanarPose:
    """Pose of a robot in metres and radians, such as 1,-0.5,1.57."""
    return PlanarPose(*_parse_three_floats(text, "a pose is three numbers X,Y,YAW"))


def _parse_velocity(text: str) -> PlanarVelocity:
    return PlanarVelocity(*_parse_three_floats(text, "a velocity is three numbers VX,VY,YAWRATE"))


def _parse_three_floats(text: str, expected: str) -> tuple[float, float, float]:
    """Three finite numbers, separated by commas."""
    try:
        first, second, third = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{expected}, not {text!r}") from None
    if not all(map(math.isfinite, (first, second, third))):
        raise argparse.ArgumentTypeError(f"{expected}, not {text!r}")
    return first, second, third


@dataclass(frozen=True, slots=True)
class _CameraEffectReport:
    """Decisions about the effects of one camera, and the time of a frame."""

    robot: str
    """Class of the robot."""
    camera: str
    plan: str
    effects: tuple[EffectDecision, ...]
    """Decisions in optical order."""
    effect_ms: dict[str, float]
    """Median milliseconds of each effect that the frame draws, of scene effects by difference."""
    other_ms: float
    """Median milliseconds of all else."""
    viewpoint: str = ""
    """Miss, near limit and clearance of a mirror without a single viewpoint; empty for others."""
    error_bounds: Mapping[str, float] | None = None
    """Error bound of the frame and its parts, as in its header; None without."""

    def __str__(self) -> str:
        # Sums of the numbers as printed, so that the lines agree to the last digit.
        effects_ms = sum(round(ms, 1) for ms in self.effect_ms.values())
        other_ms = round(self.other_ms, 1)
        head = f"{self.robot} {self.camera}: {self.plan}"
        cost = (
            f"a frame takes {other_ms + effects_ms:.1f} ms: {effects_ms:.1f} ms for effects, "
            f"{other_ms:.1f} ms for all else"
        )
        parts = (self.error_bounds or {}).items()
        bound = ", ".join(f"{name} {value:.3g}" for name, value in parts) or "none"
        # Only a mirror without a viewpoint has this line.
        viewpoint = (self.viewpoint,) if self.viewpoint else ()
        effects = format_decisions(self.effects, self.effect_ms)
        return "\n".join((head, f"error bound: {bound}", *viewpoint, effects, cost))


def _explain_robot(
    startup: StartupConfig, robot: RobotDescription, parsed: argparse.Namespace
) -> Iterator[_CameraEffectReport]:
    """Yield the report of each camera of a robot class, the omnidirectional one first."""
    requests = _request_views(robot, stand_robot(startup, robot, parsed.pose), parsed.velocity)
    if not requests:
        return
    gains = widest_gains(startup.effect_settings)
    choice = choose_renderer(parsed.renderer, startup.scene, startup.world, gains=gains)
    # With the frame times that servers on this machine have kept, as a server's own choice.
    cache = CostCache(find_cache_folder("costs"), startup.scene)
    summarizer = SceneSummarizer(startup.scene, startup.world)
    planner = RenderPlanner(RendererPool(choice), cache)
    views = ViewCache(planner, summarizer, calibration_states=make_start_states(startup))
    try:
        for name, request in requests.items():
            view, effect_ms, other_ms = measure_effect_times(views.render, request)
            yield _CameraEffectReport(
                robot.class_name,
                name,
                view.frame_plan.plan_text,
                view.effect_decisions,
                effect_ms,
                other_ms,
                _explain_viewpoint(request, summarizer),
                view.frame_plan.bounds,
            )
    finally:
        views.close()


def _explain_viewpoint(request: ViewRequest, summarizer: SceneSummarizer) -> str:
    """Line of a camera whose mirror has no viewpoint; empty for others."""
    if not isinstance(request.camera, OmniCameraSpec):
        return ""
    nearest_m = summarizer.min_distance_m(
        request.camera_state, has_ego_body=shows_ego_body(request.camera)
    )
    return explain_viewpoint(request.camera, nearest_m)


def _request_views(
    robot: RobotDescription, base: Pose, velocity: PlanarVelocity
) -> dict[str, ViewRequest]:
    """View of each camera by name, all joints at 0, of a robot whose chassis has a pose."""
    requests: dict[str, ViewRequest] = {}
    for omni in robot.omni_cameras:
        spec = OmniCameraSpec(omni.camera, omni.render_settings, omni.effects)
        state = _camera_state(robot, omni, base, velocity)
        requests[omni.name] = ViewRequest(spec, state)
    twist = velocity.twist.rotate(base.rotation)
    for description in robot.perspective_cameras:
        camera = PerspectiveCameraSensor(description, robot)
        state = mounted_camera_state(base, camera.robot_from_camera({}), twist=twist)
        requests[camera.name] = ViewRequest(camera.camera_spec(), state)
    return requests


def build_camera_state(
    robot: RobotDescription, omni: OmniCameraDescription, pose: PlanarPose, velocity: PlanarVelocity
) -> CameraState:
    """State of a robot's omnidirectional camera on the plane z = 0, while the robot drives."""
    return _camera_state(robot, omni, pose.at_height(robot.drive.ride_height_m), velocity)


def _camera_state(
    robot: RobotDescription, omni: OmniCameraDescription, base: Pose, velocity: PlanarVelocity
) -> CameraState:
    twist = velocity.twist.rotate(base.rotation)
    mesh = build_ego_mesh(robot)
    return mounted_camera_state(
        base,
        robot.robot_from_omni(omni, {}),
        twist=twist,
        ego_body=DynamicObject(mesh, base, twist) if mesh is not None else None,
    )


def stand_robot(startup: StartupConfig, robot: RobotDescription, pose: PlanarPose | None) -> Pose:
    """Pose of the chassis on the ground at a place, or at the first start of the world."""
    start = next(iter(startup.world.starts), None)
    (x_m, y_m, z_m), (_, _, yaw_rad) = (
        (start.location_m, start.rotation_rad) if start else ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    )
    pose, z_m = (pose, 0.0) if pose else (PlanarPose(x_m, y_m, yaw_rad), z_m)
    index = CollisionIndex(startup.scene, create_ray_caster(startup))
    try:
        return index.place(robot, pose, z_m).world_from_robot
    except NoStandError as error:
        log.warning("at %s %s: drawn upright, on the plane z = 0", pose, error)
        return pose.at_height(robot.drive.ride_height_m)


def measure_effect_times(
    render: Callable[[ViewRequest], RenderedView],
    request: ViewRequest,
    *,
    num_frames: int = _NUM_FRAMES,
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[RenderedView, dict[str, float], float]:
    """Measure the effects of a view.

    Args:
        render: Renders a view, as `ViewCache.render`.
        request: View of a camera with effects.
        num_frames: Frames of each kind that count, beside two that do not.
        clock: Clock in seconds.

    Returns:
        The view with all effects; the median milliseconds of each effect that the frame draws, in
        optical order; those of all else. The times add up to those of a frame.
    """
    view = render(request)
    drawn = [one.effect for one in view.effect_decisions if _acts_on_frame(one)]
    staged = [name for name in drawn if name in view.image.stage_ms]
    unstaged = [name for name in drawn if name not in view.image.stage_ms]
    # From none to all: each kind of frame has one more.
    requests = [_leave_out(request, unstaged[count:]) for count in range(len(unstaged) + 1)]
    rest_ms: list[list[float]] = [[] for _ in requests]
    stages_ms: dict[str, list[float]] = {name: [] for name in staged}
    for number in range(_WARM_UP + num_frames):
        # By turns, so that another load of the machine slows all alike.
        for variant, times in zip(requests, rest_ms, strict=True):
            begin_s = clock()
            rendered = render(variant)
            stage_ms = rendered.image.stage_ms
            staged_ms = sum(stage_ms.get(name, 0.0) for name in staged)
            if number >= _WARM_UP:
                times.append(1e3 * (clock() - begin_s) - staged_ms)
        if number >= _WARM_UP:
            for name in staged:
                stages_ms[name].append(stage_ms.get(name, 0.0))
    cumulative = _limit_by_later([median(times) for times in rest_ms])
    effect_ms = {name: median(times) for name, times in stages_ms.items()}
    effect_ms |= {
        name: after - before
        for name, before, after in zip(unstaged, cumulative, cumulative[1:], strict=False)
    }
    return view, {name: effect_ms[name] for name in drawn}, cumulative[0]


def _leave_out(request: ViewRequest, names: Sequence[str]) -> ViewRequest:
    """Same view without some effects."""
    camera = request.camera
    if not names:
        return request
    settings = tuple(
        replace(one, mode=EffectMode.NEVER) if one.effect.name in names else one
        for one in camera.effect_settings.settings
    )
    fewer: EffectSettings = replace(camera.effect_settings, settings=settings)
    bare: CameraSpec = replace(camera, effect_settings=fewer)
    return replace(request, camera=bare)


def _acts_on_frame(decision: EffectDecision) -> bool:
    """Whether a frame draws an effect: which is on, or was decided by the frame itself."""
    return decision.enabled or decision.basis is DecisionBasis.MEASURED


def _limit_by_later(times_ms: Sequence[float]) -> list[float]:
    """Times of frames with ever more effects, none above a frame with more.

    The whole frame keeps its own time: what the noise of a measurement takes from one effect, it
    gives to the one before.
    """
    limited = [times_ms[-1]]
    for one in reversed(times_ms[:-1]):
        limited.append(min(one, limited[-1]))
    return limited[::-1]
