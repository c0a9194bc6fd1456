"""Replies of the stream: about the server at once, about robots once the simulation answers."""

from __future__ import annotations

import asyncio
import dataclasses
import threading
from collections.abc import Callable
from typing import Any

import pytest

from catoptra_protocol.camera_conf import any_camera_from_pairs, omni_camera_from_pairs
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.codec import pack_fields
from catoptra_protocol.stream.messages import (
    bytes_from_message,
    json_from_message,
    reply_from_bytes,
    reply_from_json,
)
from catoptra_protocol.stream.replies import (
    CameraReply,
    Error,
    LandmarksReply,
    NoteRecord,
    PixelReply,
    PlanReply,
    Reply,
    SensorReports,
    StateReply,
)
from catoptra_protocol.stream.requests import (
    GetLandmarksRequest,
    GetPixelRequest,
    GetStateRequest,
    GetStatusRequest,
    SetAccuracyRequest,
)
from catoptra_protocol.usarsim.commands import Note
from catoptra_protocol.usarsim.reports import OdometryReading, RangeScanReading
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.effects import DecisionBasis
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.frame import CameraChannel, ViewRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.render_thread import PlanCallback, PlanFailure
from catoptra_server.render.renderer import AccuracyTarget, RenderSettings
from catoptra_server.serve.stream.peer import StreamPeer
from catoptra_server.serve.stream.replies import (
    build_server_info,
    camera_not_found,
    camera_reply,
    landmarks_reply,
    parts_reply,
    records_from_decisions,
    request_pixel,
    request_plan,
    request_projections,
    request_state,
    status_reply,
    transform_from_pose,
)
from catoptra_server.serve.stream.router import Outbox, SendResult
from catoptra_server.serve.stream.session import PendingRequests, ReportLines, RobotSession
from catoptra_server.simulation.events import (
    AccuracyTargetChanged,
    Fault,
    LandmarksRequested,
    PixelRequested,
    SimulationEvent,
    StateRequested,
)
from catoptra_server.simulation.robot import FleetState, RobotSnapshot
from catoptra_server.simulation.robot_description import PerspectiveCameraDescription
from catoptra_server.simulation.sight import OUTSIDE, LandmarkVisibility, PixelView
from helpers.configs import FIELD, OMNI_ROBOT, ROBOTS
from helpers.fake_simulation import (
    LANDMARK,
    SERVER_INFO,
    FakeSimulation,
    create_fake_context,
    serve_fake_simulation,
)
from helpers.robots import CAMERA, FORWARD_MOUNT, LEVEL, make_p2at
from helpers.stream_peer import connect_raw_peer


def test_server_info_of_the_bundled_robot_has_its_camera() -> None:
    robot, world = read_robot(OMNI_ROBOT)[0], read_world(FIELD)[0]
    assert robot.omni_camera is not None
    info = build_server_info(
        (robot,),
        world,
        clock="realtime",
        plans={(robot.class_name, robot.omni_camera.name): "traced"},
    )
    assert robot.omni_camera is not None
    camera = info.cameras[robot.class_name, robot.omni_camera.name]
    assert camera.plan == "traced"
    assert omni_camera_from_pairs(camera.camera_model)[0].width_px == 360
    assert info.class_names == (robot.class_name,)
    assert info.landmarks == world.landmarks
    assert [start.name for start in info.start_poses] == [start.name for start in world.starts]


def test_cameras_are_of_both_kinds_and_of_the_own_class_first() -> None:
    omni, real = read_robot(OMNI_ROBOT)[0], read_robot(ROBOTS / "p2at_omni_real.ini")[0]
    front = PerspectiveCameraDescription("Front", FORWARD_MOUNT, 64, 48, 0.8, 0.4, 1.6)
    only_front = make_p2at(
        class_name="USARBot.Plain", omni_cameras=(), perspective_cameras=(front,)
    )
    robots = (omni, only_front, real)
    info = build_server_info(robots, read_world(FIELD)[0], clock="realtime", plans={})

    def find(name: str, spawned_as: str) -> tuple[str, str]:
        found = info.find_camera(name, spawned_as=spawned_as)
        assert found is not None
        return found[0]

    assert find("", "")[0] == omni.class_name
    assert find("", "plain") == ("USARBot.Plain", "Front")
    assert find("", real.class_name)[0] == real.class_name
    assert find("FRONT", "") == ("USARBot.Plain", "Front")
    assert find("Front", omni.class_name) == ("USARBot.Plain", "Front")
    assert info.find_camera("Rear", spawned_as="") is None
    camera = info.cameras["USARBot.Plain", "Front"]
    assert any_camera_from_pairs(camera.camera_model) == PerspectiveCamera(64, 48, 0.8)
    assert camera.robot_from_mirror.translation.tolist() == list(FORWARD_MOUNT.position_m)


def test_transform_when_rotated_lists_the_matrix_row_by_row() -> None:
    transform = transform_from_pose(Pose.from_rpy((1.0, 2.0, 3.0), (0.0, 0.0, 1.5)))
    assert transform.position_m == (1.0, 2.0, 3.0)
    assert transform.rotation[1] < -0.9 < 0.9 < transform.rotation[3]


def test_effect_records_have_the_duration_of_each_enabled_pass() -> None:
    decisions = (
        EffectDecision("SelfView", True, 80.0, 0.5, "it is seen"),
        EffectDecision("Vignetting", True, 9.0, 0.5, "the rim"),
        EffectDecision(
            "Blooming", False, 9.0, 4.0, "dim", None, DecisionBasis.MEASURED, 1e-3, 2e-4, 3.1
        ),
    )
    records = records_from_decisions(decisions, {"trace": 7.0, "Vignetting": 1.5})
    assert [(one.name, one.enabled, one.duration_ms) for one in records] == [
        ("SelfView", True, None),
        ("Vignetting", True, 1.5),
        ("Blooming", False, None),
    ]
    assert (records[1].bound, records[1].threshold) == (9.0, 0.5)
    assert records[1].reason == "the rim"
    dim = records[2]
    assert (dim.change, dim.visible_share, dim.share_threshold) == (3.1, 2e-4, 1e-3)


async def query(
    request: Callable[[PendingRequests, RobotSession], None], result: object
) -> tuple[Any, Reply]:
    """Event of a request, and the reply for this result of the simulation's thread at 1.5 s."""
    replies: asyncio.Queue[Reply] = asyncio.Queue()
    events = list[Any]()

    def post(event: Any) -> bool:
        events.append(event)
        thread = threading.Thread(target=event.reply, args=(1.5, result))
        thread.start()
        thread.join()
        return True

    session = RobotSession(post, on_fault=print)
    request(PendingRequests(replies.put_nowait), session)
    (event,) = events
    assert event.client is session
    return event, await replies.get()


async def query_projections(
    request: GetLandmarksRequest, result: tuple[LandmarkVisibility, ...] | Fault | None
) -> Reply:
    event, reply = await query(
        lambda pending, session: request_projections(request, pending.add(request.id), session),
        result,
    )
    assert isinstance(event, LandmarksRequested)
    assert event.channel == CameraChannel("A", "")
    return reply


def test_landmarks_without_a_camera_are_the_true_ones() -> None:
    reply = landmarks_reply(1, (LANDMARK,))
    assert (reply.landmarks[0].name, reply.landmarks[0].visible) == ("a", None)
    assert reply.time_s is None


async def test_landmarks_of_a_camera_have_their_projections() -> None:
    projected = LandmarkVisibility(LANDMARK, (3.0, 4.0), True)
    reply = await query_projections(GetLandmarksRequest(2, "A"), (projected,))
    assert isinstance(reply, LandmarksReply)
    (record,) = reply.landmarks
    assert (record.pixel, record.visible, reply.time_s) == ((3.0, 4.0), True, 1.5)


async def test_landmarks_of_a_missing_camera_are_an_error() -> None:
    error = Error(3, "there is no camera of robot 'A'")
    assert await query_projections(GetLandmarksRequest(3, "A", ""), None) == error


async def test_landmarks_when_their_projection_failed_are_an_error_with_the_reason() -> None:
    reply = await query_projections(GetLandmarksRequest(3, "A", ""), Fault("a fault"))
    assert reply == Error(3, "a fault")


def test_error_when_no_robot_is_named_speaks_of_the_image_port() -> None:
    reason = "there is no camera 'Rear' of the robot on the image port"
    assert camera_not_found(4, "", "Rear") == Error(4, reason)


async def query_pixel(view: PixelView | Fault | None) -> Reply:
    request = GetPixelRequest(7, "A", "Omni", 3.5, 4.5)
    event, reply = await query(
        lambda pending, session: request_pixel(request, pending.add(7), session), view
    )
    assert isinstance(event, PixelRequested)
    assert (event.channel, event.point_px) == (CameraChannel("A", "Omni"), (3.5, 4.5))
    return reply


@pytest.mark.parametrize(
    ("view", "expected"),
    [
        (PixelView(1.0, 2.0, 3.0, "wall", 0.5), PixelReply(7, 1.5, 1.0, 2.0, 3.0, "wall", 0.5)),
        (OUTSIDE, PixelReply(7, 1.5, None, None, None, "", None)),
        (Fault("broken"), Error(7, "broken")),
        (None, Error(7, "there is no camera 'Omni' of robot 'A'")),
    ],
)
async def test_reply_is_that_of_the_simulation(
    view: PixelView | Fault | None, expected: Reply
) -> None:
    assert await query_pixel(view) == expected


async def query_plan(
    request: SetAccuracyRequest, *, result: Fault | str | None = "camera"
) -> tuple[Reply, list[AccuracyTargetChanged]]:
    """Reply of a server whose simulation finds a camera or this result; the posted events."""
    simulation = FakeSimulation()
    replies: list[Reply] = []
    async with serve_fake_simulation(simulation) as server:
        with connect_raw_peer(server.port) as peer:
            await peer.send(bytes_from_message(request))
            await peer.send(bytes_from_message(GetStatusRequest(99)))
            replies.append((await peer.receive())[0])  # an error, or the status
            for change in accuracy_changes(simulation):
                target = AccuracyTarget().with_changes(
                    max_error_px=change.max_error_px, budget_ms=change.budget_ms
                )
                spec = OmniCameraSpec(CAMERA.camera, RenderSettings(accuracy_target=target))
                found = ViewRequest(spec, LEVEL) if isinstance(result, str) else result
                change.reply(found, change.camera or "Omni")
                replies.append((await peer.receive())[0])
    return (replies[-1], accuracy_changes(simulation))


def accuracy_changes(simulation: FakeSimulation) -> list[AccuracyTargetChanged]:
    return [event for event in simulation.posted_events if isinstance(event, AccuracyTargetChanged)]


async def test_plan_when_a_tolerance_is_set_describes_the_resulting_plan() -> None:
    reply, posted = await query_plan(SetAccuracyRequest(1, "", 0.5, None))
    assert isinstance(reply, PlanReply)
    assert (reply.id, reply.camera, reply.max_error_px, reply.budget_ms) == (1, "Omni", 0.5, 0)
    assert reply.error_bounds is not None
    assert reply.error_bound_px == reply.error_bounds["outline_px"]
    assert (reply.median_frame_ms, reply.cost_ms, reply.more_accurate) == (12.5, None, None)
    assert [(p.camera, p.max_error_px, p.budget_ms) for p in posted] == [("", 0.5, None)]


async def test_plan_of_a_missing_camera_is_an_error() -> None:
    reply, _ = await query_plan(SetAccuracyRequest(2, "Rear", None, None), result=None)
    assert isinstance(reply, Error)
    assert "no robot with an omnidirectional camera 'Rear'" in reply.reason


async def test_plan_when_superseded_in_the_simulation_is_an_error_with_the_reason() -> None:
    reply, _ = await query_plan(SetAccuracyRequest(2, "", 0.5, None), result=Fault("superseded"))
    assert reply == Error(2, "superseded")


async def test_plan_when_the_render_thread_has_none_is_an_error_with_the_reason() -> None:
    replies: asyncio.Queue[Reply] = asyncio.Queue()
    clients = []

    def post(event: SimulationEvent) -> bool:
        assert isinstance(event, AccuracyTargetChanged)
        event.reply(ViewRequest(OmniCameraSpec(CAMERA.camera, RenderSettings()), LEVEL), "Omni")
        return True

    def find_no_plan(client: object, view: ViewRequest, reply: PlanCallback) -> None:
        clients.append(client)
        reply(PlanFailure("no plan"))

    session = RobotSession(post, on_fault=print)
    pending = PendingRequests(replies.put_nowait).add(4)
    request_plan(SetAccuracyRequest(4, "", None, None), pending, session, find_no_plan)
    assert await replies.get() == Error(4, "no plan")
    assert clients == [session]


async def test_plan_with_a_negative_budget_is_an_error_before_any_change() -> None:
    reply, posted = await query_plan(SetAccuracyRequest(3, "", None, -1.0))
    assert reply == Error(3, "budget_ms must be 0 (no target) or more, not -1.0")
    assert posted == []


POSE = Pose.from_rpy((1.0, 2.0, -0.2), (0.0, 0.0, 0.5))
START = Pose.from_rpy((0.0, 0.0, -0.2))
STATE = FleetState(
    (RobotSnapshot("A", "USARBot.P2AT", POSE, START, (1.0, -1.0), True, 0.13, 0.47),),
    "A",
    (OdometryReading("Odometry", 1.0, 2.0, 0.5),),
    ((Note("ekf", '{"pose":[1.0,2.0,0.5]}'), 1.25),),
)


async def query_state(result: FleetState | Fault) -> Reply:
    request, lines = GetStateRequest(7, "A"), ReportLines()
    event, reply = await query(
        lambda pending, session: request_state(request, pending.add(7), session, lines), result
    )
    assert isinstance(event, StateRequested)
    assert event.robot == "A"
    return reply


async def test_state_has_robots_lines_and_notes() -> None:
    reply = await query_state(STATE)
    assert isinstance(reply, StateReply)
    assert (reply.id, reply.time_s, reply.robot) == (7, 1.5, "A")
    (robot,) = reply.robots
    assert robot.world_from_robot.position_m == (1.0, 2.0, -0.2)
    assert robot.world_from_start.position_m == (0.0, 0.0, -0.2)
    assert (robot.wheel_speeds_rad_s, robot.shares_control) == ((1.0, -1.0), True)
    assert (robot.wheel_radius_m, robot.wheel_separation_m) == (0.13, 0.47)
    assert reply.reports == ("SEN {Type Odometry} {Name Odometry} {Pose 1.0000,2.0000,0.5000}",)
    assert reply.notes == (NoteRecord("ekf", 1.25, '{"pose":[1.0,2.0,0.5]}'),)


async def test_state_when_the_simulation_failed_is_an_error() -> None:
    assert await query_state(Fault("see the log")) == Error(7, "see the log")


async def test_state_of_the_largest_fleet_fits_into_a_reply() -> None:
    robots = tuple(
        RobotSnapshot("r" * 256, "c" * 256, POSE, START, (1.1, -1.1), True, 0.1, 0.5)
        for _ in range(64)
    )
    scan = RangeScanReading(1.5, "Scanner", 0.0175, 3.1416, (20.0 / 3.0,) * 361)
    text = '{"x":"' + 8184 * "\\" + '"}'
    notes = tuple((Note(f"{n}" * 64, text), 1.25) for n in range(8))
    reply = await query_state(FleetState(robots, "r" * 256, (scan,) * 16, notes))
    assert reply_from_bytes(bytes_from_message(reply)) == reply
    assert reply_from_json(json_from_message(reply)) == reply


async def test_clients_are_those_between_connection_and_disconnection() -> None:
    context = create_fake_context(FakeSimulation())
    outbox = Outbox(lambda _: SendResult.SENT, on_blocked=lambda: None, on_overflow=lambda: None)
    first, second = (StreamPeer(outbox, context, address=name, encode=pack_fields) for name in "ab")
    assert context.clients == {first, second}
    first.disconnect()
    first.disconnect()
    assert context.clients == {second}


async def test_camera_is_found_by_name_and_an_unknown_one_is_an_error_with_the_known() -> None:
    robot = RobotSession(FakeSimulation().post, on_fault=lambda _: None)
    found = camera_reply(1, "omni", SERVER_INFO, robot)
    assert isinstance(found, CameraReply)
    assert (found.class_name, found.camera, found.plan) == ("USARBot.OmniP2AT", "Omni", "traced")
    reason = "there is no camera 'Rear': this server's robots have Omni"
    assert camera_reply(2, "Rear", SERVER_INFO, robot) == Error(2, reason)


def test_parts_are_the_configuration_of_a_class_and_mounts_of_its_sensors() -> None:
    info = dataclasses.replace(SERVER_INFO, robots=(read_robot(ROBOTS / "p2at.ini")[0],))
    reply = parts_reply(1, "p2at", info)
    assert isinstance(reply, SensorReports)
    wheels, *sensors = reply.reports
    assert "{MaxSpeed 5.3850}" in wheels
    place = sensors.index(
        "CONF {Type Sonar} {Name F1} {MaxRange 5.0000} {MinRange 0.1000} {BeamAngle 0.3491}"
    )
    assert sensors[place + 1].startswith("GEO {Type Sonar} {Name F1 Location 0.1450,-0.1300,")
    assert isinstance(parts_reply(2, "none", info), Error)


async def test_status_counts_the_clients_of_all_transports() -> None:
    context = create_fake_context(FakeSimulation())
    context.clients.update({object(), object()})
    robot = RobotSession(context.post, on_fault=lambda _: None)
    status = status_reply(7, context, robot, num_sent=3)
    assert (status.id, status.num_clients, status.sent_frames) == (7, 2, 3)
    assert (status.world, status.has_robot) == ("field", False)
