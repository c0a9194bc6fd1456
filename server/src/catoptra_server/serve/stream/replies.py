"""Replies of the stream other than frames: about the server, cameras, landmarks and robots.

What is constant is answered at once. A `request_...` function posts its question to the simulation
and answers the pending request when the result is there: projections of landmarks, a point of an
image, the plan of a camera, the state of all robots. A plan needs two threads: the simulation holds
the camera, the render thread its plan. A newer request of the client supersedes one that waits in
either.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import field
from functools import partial
from typing import cast

from catoptra_protocol.camera_conf import Pairs, pairs_from_omni_camera
from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.names import list_names
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.messages import SCHEMA_VERSION
from catoptra_protocol.stream.replies import (
    CameraReply,
    CommandRecord,
    EffectRecord,
    Error,
    LandmarkRecord,
    LandmarksReply,
    NoteRecord,
    PixelReply,
    PlanAlternative,
    PlanReply,
    Reply,
    RobotState,
    SensorReports,
    SetupReply,
    StartPoseRecord,
    StateReply,
    StatusReply,
    TickRecord,
)
from catoptra_protocol.stream.requests import (
    GetLandmarksRequest,
    GetPixelRequest,
    GetStateRequest,
    SetAccuracyRequest,
    Transform,
)
from catoptra_protocol.usarsim.reports import Geometry, GeometryItem, Report
from catoptra_server import __version__
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.frame import CameraChannel, ViewRequest
from catoptra_server.frames.frame_plan import ViewState
from catoptra_server.frames.mailbox import Mailboxes
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.plans import PlanOption
from catoptra_server.frames.render_thread import PlanCallback, PlanFailure
from catoptra_server.render.renderer import AccuracyTarget
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.serve.stream.session import (
    PendingRequest,
    Post,
    ReportLines,
    RobotSession,
    lines_from_reports,
)
from catoptra_server.simulation.commands import vehicle_configuration, vehicle_geometry
from catoptra_server.simulation.events import (
    AccuracyTargetChanged,
    Fault,
    LandmarksRequested,
    PixelRequested,
    StateRequested,
)
from catoptra_server.simulation.robot import FleetState, RobotSnapshot
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.simulation.sensors import build_sensors
from catoptra_server.simulation.sensors.perspective_camera import PerspectiveCameraSensor
from catoptra_server.simulation.sight import LandmarkVisibility, PixelView
from catoptra_server.simulation.spawning import SpawnError, find_class
from catoptra_server.world.world_description import World

# Class of the robot, name of the camera.
_CameraKey = tuple[str, str]
# Client, camera, and the callback with the camera's plan, called by any thread.
_QueryPlan = Callable[[Hashable, ViewRequest, PlanCallback], None]
_NO_SETUP = SetupReply(0, {}, {}, {})


@dataclass(frozen=True, slots=True, eq=False)
class StreamContext:
    """One for all clients of a server, on ZeroMQ and on WebSockets."""

    mailboxes: Mailboxes
    """Newest frame of each channel."""
    post: Post
    """Hands an event to the simulation; thread-safe."""
    server_info: ServerInfo
    """Constant part of the replies."""
    query_plan: _QueryPlan
    """Asks the render thread for the plan of a camera."""
    report_lines: ReportLines = field(default_factory=ReportLines)
    """Lines of the reports that several clients read."""
    clients: set[object] = field(default_factory=set)
    """Connected clients; each adds and removes itself."""


@dataclass(frozen=True, slots=True, eq=False)
class ServerInfo:
    """Server, world, robot classes, clock, cameras, landmarks and start poses."""

    server: str
    """Product and release."""
    world: str
    """Name of the world."""
    robots: tuple[RobotDescription, ...]
    """Robot classes that can be spawned."""
    clock: str
    """`realtime` or `lockstep`."""
    cameras: dict[_CameraKey, CameraInfo]
    """Cameras by class of the robot and name of the camera, the omnidirectional one of a class
    first."""
    landmarks: tuple[Landmark, ...]
    start_poses: tuple[StartPoseRecord, ...]
    setup: SetupReply = _NO_SETUP

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Names of the cameras, of all classes."""
        return tuple(name for _, name in self.cameras)

    @property
    def class_names(self) -> tuple[str, ...]:
        """Names of the robot classes."""
        return tuple(robot.class_name for robot in self.robots)

    def find_camera(self, name: str, *, spawned_as: str) -> tuple[_CameraKey, CameraInfo] | None:
        """Camera of a name in any case, of the class of a robot or else of the first that has it.

        Args:
            name: Name of the camera; empty for the first one.
            spawned_as: Class of the client's robot as the spawn request names it; empty without a
                robot.
        """
        own = find_class(self.robots, spawned_as).class_name if spawned_as else ""
        found = [
            (key, info)
            for key, info in self.cameras.items()
            if name.lower() in ("", key[1].lower())
        ]
        # False sorts before True, and the order of the classes is kept.
        return min(found, key=lambda entry: entry[0][0] != own, default=None)


@dataclass(frozen=True, slots=True, eq=False)
class CameraInfo:
    """A camera of a robot class, of either kind."""

    camera_model: Pairs
    """Pairs of CONF."""
    robot_from_mirror: Pose
    """Pose of the effective viewpoint, or of the pinhole with all joints at 0."""
    plan: str | None = None
    """Description of the rendering plan, if known at the start; None for a perspective camera."""


def build_server_info(
    robots: Sequence[RobotDescription],
    world: World,
    *,
    clock: str,
    plans: Mapping[_CameraKey, str],
    setup: SetupReply = _NO_SETUP,
) -> ServerInfo:
    """Collect the information about a server.

    Args:
        robots: Robot classes.
        world: World.
        clock: `realtime` or `lockstep`.
        plans: Description of the rendering plan by camera.
        setup: Files and options of the server.
    """
    cameras: dict[_CameraKey, CameraInfo] = {}
    # Cameras of classes and not of robots, so that clients can read a model before any robot
    # exists.
    for robot in robots:
        cameras |= _cameras_of_class(robot, plans)
    return ServerInfo(
        server=f"Catoptra {__version__}",
        world=world.name,
        robots=tuple(robots),
        clock=clock,
        cameras=cameras,
        landmarks=world.landmarks,
        start_poses=tuple(
            StartPoseRecord(s.name, s.location_m, s.rotation_rad) for s in world.starts
        ),
        setup=setup,
    )


def _cameras_of_class(
    robot: RobotDescription, plans: Mapping[_CameraKey, str]
) -> dict[_CameraKey, CameraInfo]:
    cameras: dict[_CameraKey, CameraInfo] = {}
    for omni in robot.omni_cameras:
        pairs = pairs_from_omni_camera(omni.camera, robot.viewpoint_height_m(omni))
        mount = robot.robot_from_omni(omni, {})
        cameras[robot.class_name, omni.name] = CameraInfo(
            pairs, mount, plans.get((robot.class_name, omni.name))
        )
    for description in robot.perspective_cameras:
        camera = PerspectiveCameraSensor(description, robot)
        info = CameraInfo(camera.camera_model(), camera.robot_from_camera({}))
        cameras[robot.class_name, camera.name] = info
    return cameras


def setup_reply(id_: int, info: ServerInfo) -> SetupReply:
    """Reply with files and options of the server."""
    return dataclasses.replace(info.setup, id=id_)


def status_reply(
    id_: int, context: StreamContext, robot: RobotSession, *, num_sent: int
) -> StatusReply:
    """Reply with the identity of the server, and the state for one client."""
    info = context.server_info
    return StatusReply(
        version=SCHEMA_VERSION,
        id=id_,
        server=info.server,
        world=info.world,
        class_names=info.class_names,
        clock=info.clock,
        num_clients=len(context.clients),
        has_robot=robot.has_robot,
        sent_frames=num_sent,
    )


def camera_reply(
    id_: int, camera: str, info: ServerInfo, robot: RobotSession
) -> CameraReply | Error:
    """Reply with the camera of a name, of the client's robot first."""
    found = info.find_camera(camera, spawned_as=robot.class_name if robot.has_robot else "")
    if found is None:
        return _camera_not_found(id_, f"camera {camera[:80]!r}", camera, info.camera_names)
    (class_name, name), camera_info = found
    mount = transform_from_pose(camera_info.robot_from_mirror)
    model = dict(camera_info.camera_model)
    return CameraReply(id_, class_name, name, model, mount, camera_info.plan)


def parts_reply(id_: int, class_name: str, info: ServerInfo) -> SensorReports | Error:
    """Reply with CONF and GEO of a robot class, and of each of its sensors."""
    try:
        robot = find_class(info.robots, class_name)
    except SpawnError as error:
        return Error(id_, str(error))
    sensors = build_sensors(
        robot.sensors, robot.drive, lambda part: RandomSource.from_names(0, part)
    )
    parts = [part for sensor in sensors for part in sensor.parts]
    reports: list[Report] = [vehicle_configuration(robot), vehicle_geometry(robot)]
    for part in parts:
        geometry = part.geometry()
        assert isinstance(geometry, GeometryItem), "a sensor has no links"
        reports += [part.configuration(), Geometry(part.type, (geometry,))]
    return SensorReports(id_, lines_from_reports(reports))


def landmarks_reply(id_: int, landmarks: Sequence[Landmark]) -> LandmarksReply:
    """Reply with the true positions, without a camera's view."""
    return LandmarksReply(id_, tuple(map(_record_from_landmark, landmarks)))


def _record_from_landmark(landmark: Landmark) -> LandmarkRecord:
    fields = dataclasses.fields(Landmark)
    return LandmarkRecord(**{field.name: getattr(landmark, field.name) for field in fields})


def request_projections(
    request: GetLandmarksRequest, pending: PendingRequest, session: RobotSession
) -> None:
    """Have the simulation project the landmarks into a camera, and reply then.

    Args:
        request: Request with a robot or a camera, or with two empty names.
        pending: Receives the reply.
        session: Client of the simulation.
    """

    def reply(time_s: float, result: tuple[LandmarkVisibility, ...] | Fault | None) -> None:
        pending.reply_from_thread(partial(_projections_reply, request, time_s, result))

    channel = CameraChannel(request.robot or "", request.camera or "")
    session.post(LandmarksRequested(session, channel, reply))


def _projections_reply(
    request: GetLandmarksRequest,
    time_s: float,
    result: tuple[LandmarkVisibility, ...] | Fault | None,
) -> Reply:
    if result is None:
        return camera_not_found(request.id, request.robot or "", request.camera or "")
    if isinstance(result, Fault):
        return Error(request.id, result.reason)
    records = (
        dataclasses.replace(
            _record_from_landmark(one.landmark), pixel=one.pixel, visible=one.is_visible
        )
        for one in result
    )
    return LandmarksReply(request.id, tuple(records), time_s)


def request_pixel(request: GetPixelRequest, pending: PendingRequest, session: RobotSession) -> None:
    """Have the simulation cast the ray through a point of an image, and reply then.

    Args:
        request: Request of the client.
        pending: Receives the reply.
        session: Client of the simulation.
    """

    def reply(time_s: float, view: PixelView | Fault | None) -> None:
        pending.reply_from_thread(partial(_pixel_reply, request, time_s, view))

    channel = CameraChannel(request.robot, request.camera)
    session.post(PixelRequested(session, channel, (request.u_px, request.v_px), reply))


def _pixel_reply(request: GetPixelRequest, time_s: float, view: PixelView | Fault | None) -> Reply:
    if view is None:
        return camera_not_found(request.id, request.robot, request.camera)
    if isinstance(view, Fault):
        return Error(request.id, view.reason)
    return PixelReply(
        id=request.id,
        time_s=time_s,
        theta_rad=view.theta_rad,
        azimuth_rad=view.azimuth_rad,
        range_m=view.range_m,
        object=view.object_name,
        bound_px=view.bound_px,
    )


def request_plan(
    request: SetAccuracyRequest,
    pending: PendingRequest,
    session: RobotSession,
    query_plan: _QueryPlan,
) -> None:
    """Reply once the simulation has set the target and the render thread has planned.

    Args:
        request: Request of the client.
        pending: Receives the reply.
        session: Client of the simulation, with the robot.
        query_plan: Hands a camera to the render thread.
    """
    # Checked here and not in the simulation, so that a wrong number is answered at once.
    try:
        AccuracyTarget().with_changes(
            max_error_px=request.max_error_px, budget_ms=request.budget_ms
        )
    except DomainError as error:
        pending.reject(str(error))
        return

    def query_camera_plan(view: ViewRequest | Fault | None, name: str) -> None:
        # `name` names the camera that the simulation selected: a request may leave the name empty.
        if not isinstance(view, ViewRequest):
            pending.reply_from_thread(partial(_camera_error, request.id, name, view))
            return
        make_reply = partial(_plan_reply, request.id, name, view)
        query_plan(
            session, view, lambda state: pending.reply_from_thread(partial(make_reply, state))
        )

    session.post(
        AccuracyTargetChanged(
            session, request.camera, request.max_error_px, request.budget_ms, query_camera_plan
        )
    )


def _plan_reply(id_: int, name: str, view: ViewRequest, state: ViewState | PlanFailure) -> Reply:
    if isinstance(state, PlanFailure):
        return Error(id_, state.reason)
    # The target as the simulation has it, not as requested: None in a request leaves a value
    # unchanged.
    choice = state.choice
    target = cast(OmniCameraSpec, view.camera).render_settings.accuracy_target
    return PlanReply(
        id=id_,
        camera=name,
        max_error_px=target.max_error_px,
        budget_ms=target.budget_ms,
        plan=choice.text,
        target_met=choice.target_met,
        error_bound_px=choice.bound.outline_error_px if choice.bound else None,
        error_bounds=choice.bound.numbers_by_name() if choice.bound else None,
        cost_ms=choice.predicted_ms,
        median_frame_ms=state.median_ms,
        more_accurate=plan_alternative(choice.more_accurate),
        faster=plan_alternative(choice.faster),
    )


def _camera_error(id_: int, name: str, fault: Fault | None) -> Error:
    if fault is not None:
        return Error(id_, fault.reason)
    return Error(id_, f"this client has no robot with an omnidirectional camera {name[:80]!r}")


def request_state(
    request: GetStateRequest,
    pending: PendingRequest,
    session: RobotSession,
    report_lines: ReportLines,
) -> None:
    """Have the simulation collect the state, and reply then.

    Args:
        request: Request of the client.
        pending: Receives the reply.
        session: Client of the simulation.
        report_lines: Makes the lines of the readings.
    """

    def reply(time_s: float, state: FleetState | Fault) -> None:
        pending.reply_from_thread(partial(_state_reply, request.id, time_s, state, report_lines))

    session.post(
        StateRequested(session, request.robot, request.commands_after, request.ticks_after, reply)
    )


def _state_reply(
    id_: int, time_s: float, state: FleetState | Fault, report_lines: ReportLines
) -> Reply:
    if isinstance(state, Fault):
        return Error(id_, state.reason)
    return StateReply(
        id=id_,
        time_s=time_s,
        robots=tuple(map(_robot_state, state.robots)),
        robot=state.robot,
        reports=report_lines.get(state.reports),
        notes=tuple(NoteRecord(note.name, time_s, note.text) for note, time_s in state.notes),
        commands=tuple(CommandRecord(*one) for one in state.commands),
        ticks=tuple(
            TickRecord(
                tick.time_s,
                transform_from_pose(tick.world_from_robot),
                tick.wheel_speeds_rad_s,
                report_lines.get(tick.reports),
            )
            for tick in state.ticks
        ),
    )


def _robot_state(snapshot: RobotSnapshot) -> RobotState:
    return RobotState(
        name=snapshot.name,
        class_name=snapshot.class_name,
        world_from_robot=transform_from_pose(snapshot.world_from_robot),
        world_from_start=transform_from_pose(snapshot.world_from_start),
        wheel_speeds_rad_s=snapshot.wheel_speeds_rad_s,
        shares_control=snapshot.shares_control,
        wheel_radius_m=snapshot.wheel_radius_m,
        wheel_separation_m=snapshot.wheel_separation_m,
    )


def camera_not_found(
    id_: int, robot: str, camera: str, known: tuple[str, ...] | None = None
) -> Error:
    """Error for a camera that does not exist, by name, with the known cameras of all robots."""
    owner = f"robot {robot!r}" if robot else "the robot on the image port"
    name = f"camera {camera!r}" if camera else "camera"
    # Without a name the robot is missing.
    return _camera_not_found(id_, f"{name} of {owner}", camera, known if camera else None)


def _camera_not_found(id_: int, what: str, camera: str, known: tuple[str, ...] | None) -> Error:
    names = "" if known is None else f": this server's robots have {list_names(camera, known)}"
    return Error(id_, f"there is no {what}{names}")


def plan_alternative(option: PlanOption | None) -> PlanAlternative | None:
    """Record of a neighbour of a plan; None for none."""
    return (
        PlanAlternative(option.plan.description, option.error_bound_px, option.predicted_ms)
        if option
        else None
    )


def transform_from_pose(pose: Pose) -> Transform:
    """Transform of a pose, for a message."""
    # msgpack encodes Python's floats, not NumPy's.
    x, y, z = map(float, pose.translation)
    a, b, c, d, e, f, g, h, i = map(float, pose.rotation.ravel())
    return Transform((x, y, z), (a, b, c, d, e, f, g, h, i))


def records_from_decisions(
    decisions: Sequence[EffectDecision], stage_ms: Mapping[str, float]
) -> tuple[EffectRecord, ...]:
    """Records of effect decisions, with the durations of a frame by stage."""
    # An effect that changes the scene has no stage; one that was measured and left out has one.
    return tuple(
        _record_from_decision(decision, stage_ms.get(decision.effect)) for decision in decisions
    )


def _record_from_decision(decision: EffectDecision, ms: float | None) -> EffectRecord:
    return EffectRecord(
        name=decision.effect,
        enabled=decision.enabled,
        bound=decision.bound,
        threshold=decision.threshold,
        displacement_px=decision.displacement_px,
        reason=decision.reason,
        duration_ms=float(ms) if decision.enabled and ms is not None else None,
        basis=decision.basis.value,
        change=decision.change,
        share_threshold=decision.share_threshold,
        visible_share=decision.visible_share,
    )
