"""One client over the loopback, with a simulation whose replies the test plays."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import pytest

from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import (
    CameraReply,
    Error,
    Ok,
    Reply,
    SensorReports,
    StateReply,
)
from catoptra_protocol.stream.requests import (
    DriveRequest,
    GetCameraRequest,
    GetReadingsRequest,
    GetStateRequest,
    GetStatusRequest,
    PublishRequest,
    Request,
    ResetRequest,
    ShareControlRequest,
    SpawnRequest,
    StepRequest,
)
from catoptra_protocol.usarsim.reports import InitResult, OdometryReading, VehicleStatus
from catoptra_server.serve.stream import peer as peer_module
from catoptra_server.serve.stream.peer import StreamPeer, StreamServer
from catoptra_server.serve.stream.session import RobotSession
from catoptra_server.simulation.events import (
    ClientDisconnected,
    NotePublished,
    ResetRequested,
    SharedRobotDriven,
    SimulationEvent,
    StateRequested,
    StepRequested,
    StepResult,
)
from catoptra_server.simulation.robot import FleetState
from helpers.fake_simulation import FakeSimulation, serve_fake_simulation
from helpers.loopback import wait_until
from helpers.stream_messages import SAMPLE_REQUESTS
from helpers.stream_peer import RawPeer, connect_raw_peer

SPAWN = SpawnRequest(1, "USARBot.OmniP2AT", "Mine", None, "Centre")
STATUS = VehicleStatus(1.0, 100)
ODOMETRY = OdometryReading("Odometry", 1.0, 2.0, 0.5)


class PeerSession:
    """A raw peer, its StreamPeer in the server, and the simulation between them."""

    def __init__(self, raw: RawPeer, server: StreamServer, simulation: FakeSimulation) -> None:
        self.raw = raw
        self.server = server
        self.simulation = simulation

    @property
    def client(self) -> StreamPeer:
        """Only client of the server."""
        (client,) = self.server.peers
        return client

    @property
    def posted(self) -> list[SimulationEvent]:
        """Events of the client so far."""
        return self.simulation.posted_events

    async def send(self, request: Request) -> None:
        """Send a request, and wait for its event."""
        before = len(self.posted)
        await self.raw.send(bytes_from_message(request))
        await wait_until(lambda: len(self.posted) > before, f"event of {request}")

    async def receive(self) -> Reply:
        """Next reply."""
        return (await self.raw.receive())[0]

    async def spawn(self) -> Reply:
        """Spawn a robot; the reply."""
        await self.send(SPAWN)
        self.client.robot.finish_init(InitResult(0.0, "Mine"))
        self.client.robot.deliver([ODOMETRY, STATUS])
        return await self.receive()


@asynccontextmanager
async def open_session(simulation: FakeSimulation | None = None) -> AsyncIterator[PeerSession]:
    simulation = simulation or FakeSimulation()
    async with serve_fake_simulation(simulation) as server:
        with connect_raw_peer(server.port) as raw:
            await raw.send_request(GetStatusRequest(1000))
            yield PeerSession(raw, server, simulation)


async def test_drive_with_a_robot_is_ok_and_without_one_an_error() -> None:
    async with open_session() as session:
        drive = DriveRequest(5, 1.0, None, True)
        reply = await session.raw.send_request(drive)
        assert isinstance(reply, Error)
        assert "spawn one first" in reply.reason
        await session.spawn()
        assert await session.raw.send_request(drive) == Ok(5)


@pytest.mark.parametrize(
    "request_", [PublishRequest(5, "ekf", "{}"), ShareControlRequest(5, True)], ids=lambda r: r.KIND
)
async def test_note_and_sharing_without_a_robot_are_errors(request_: Request) -> None:
    async with open_session() as session:
        reply = await session.raw.send_request(request_)
        assert isinstance(reply, Error)
        assert "spawn one first" in reply.reason
        assert session.posted == []


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("", "{}", "0 characters"),
        ("a\x1b[2J", "{}", "printable"),
        ("a" * 5000, "{}", "5000 characters"),
        ("a", "[]", "expected an object"),
        ("a", '{"x":NaN}', "finite"),
        ("a", '{"x":' + 4000 * "[" + 4000 * "]" + "}", "nested"),
        ("a", '{"x":"' + 8185 * "y" + '"}', "at most 8192"),
        ("a", r'{"x":"\udc00"}', "surrogate"),
    ],
    ids=["no name", "escape", "long name", "list", "NaN", "deep", "giant", "surrogate"],
)
async def test_note_when_none_is_an_error_and_reaches_no_robot(
    name: str, text: str, reason: str
) -> None:
    async with open_session() as session:
        await session.spawn()
        num_posted = len(session.posted)
        reply = await session.raw.send_request(PublishRequest(5, name, text))
        assert isinstance(reply, Error)
        assert reason in reply.reason
        assert len(session.posted) == num_posted


async def test_note_is_ok_once_the_simulation_has_stored_it() -> None:
    async with open_session() as session:
        await session.spawn()
        await session.send(PublishRequest(5, "ekf", "{}"))
        event = session.posted[-1]
        assert isinstance(event, NotePublished)
        event.reply("")
        assert await session.receive() == Ok(5)
        assert await session.raw.send_request(ShareControlRequest(6, True)) == Ok(6)


async def test_drive_with_a_name_needs_no_robot_and_has_the_outcome_as_reply() -> None:
    async with open_session() as session:
        for id_, reason in ((5, ""), (6, "there is no robot 'Gone'")):
            await session.send(DriveRequest(id_, 1.0, 1.0, False, "Gone"))
            event = session.posted[-1]
            assert isinstance(event, SharedRobotDriven)
            event.reply(reason)
            assert await session.receive() == (Error(id_, reason) if reason else Ok(id_))


async def test_state_is_collected_by_the_simulation_without_a_robot() -> None:
    async with open_session() as session:
        await session.send(GetStateRequest(5, ""))
        event = session.posted[-1]
        assert isinstance(event, StateRequested)
        event.reply(1.5, FleetState(()))
        assert await session.receive() == StateReply(5, 1.5, (), "", (), ())


async def test_reset_is_ok_and_readings_are_of_the_robot_alone() -> None:
    async with open_session() as session:
        await session.spawn()
        session.client.robot.deliver([OdometryReading("Odometry", 7.0, 2.0, 0.5)])
        readings = await session.raw.send_request(GetReadingsRequest(9))
        assert isinstance(readings, SensorReports)
        assert "7.0" in readings.reports[0]
        await session.send(ResetRequest(8))
        reset = session.posted[-1]
        assert isinstance(reset, ResetRequested)
        reset.reply()
        assert await session.receive() == Ok(8)
        assert isinstance(await session.raw.send_request(GetReadingsRequest(9)), Error)
        assert isinstance(await session.spawn(), SensorReports)


async def test_requests_when_too_many_are_pending_are_errors_and_each_has_one_reply() -> None:
    async with open_session() as session:
        for number in range(1, 70):
            await session.raw.send(bytes_from_message(StepRequest(number, 0.1)))
        refused = [await session.receive() for _ in range(5)]
        reason = "64 requests are pending: wait for their replies"
        assert refused == [Error(number, reason) for number in range(65, 70)]
        for event in session.posted:
            assert isinstance(event, StepRequested)
            event.reply(StepResult(0.1))
        replies = [await session.receive() for _ in range(64)]
        assert [getattr(reply, "id", 0) for reply in replies] == list(range(1, 65))


async def test_replies_when_more_than_zeromq_takes_are_all_received_in_order() -> None:
    async with open_session() as session:
        for number in range(1, 101):
            await session.raw.send(bytes_from_message(GetStatusRequest(number)))
        replies = [await session.receive() for _ in range(100)]
        assert [getattr(reply, "id", 0) for reply in replies] == list(range(1, 101))


async def test_commands_when_the_queue_of_the_simulation_is_full_are_errors() -> None:
    simulation = FakeSimulation()
    async with open_session(simulation) as session:
        await session.spawn()
        simulation.has_room = False
        assert await session.raw.send_request(DriveRequest(2, 1.0, 1.0, False)) == Ok(2)
        reply = await session.raw.send_request(DriveRequest(3, 1.0, 1.0, False))
        assert isinstance(reply, Error)
        assert "has not executed" in reply.reason
        session.client.robot.resume_reading()
        assert await session.raw.send_request(DriveRequest(4, 1.0, 1.0, False)) == Ok(4)


async def test_fault_of_the_robot_rejects_pending_requests_and_the_client_stays() -> None:
    async with open_session() as session:
        await session.spawn()
        await session.send(StepRequest(2, 0.1))
        step, faulty = session.posted[-1], session.client.robot
        assert isinstance(step, StepRequested)
        faulty.disconnect("a fault removed the robot")
        assert await session.receive() == Error(2, "a fault removed the robot")
        step.reply(StepResult(0.1))  # too late
        assert session.posted[-1] == ClientDisconnected(faulty)
        assert not session.client.robot.has_robot
        assert isinstance(await session.spawn(), SensorReports)


async def test_camera_when_unnamed_is_that_of_the_own_robot() -> None:
    async with open_session() as session:
        await session.spawn()
        camera = await session.raw.send_request(GetCameraRequest(2, ""))
        assert isinstance(camera, CameraReply)
        assert (camera.class_name, camera.camera) == ("USARBot.OmniP2AT", "Omni")


@pytest.mark.parametrize("request_", SAMPLE_REQUESTS, ids=lambda request: request.KIND)
async def test_request_when_its_handling_raises_is_an_error_and_the_server_goes_on(
    request_: Request, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def raise_error(*arguments: object, **keywords: object) -> None:
        raise ZeroDivisionError("injected")

    simulation = FakeSimulation()
    async with open_session(simulation) as session:
        await session.spawn()
        if isinstance(request_, SpawnRequest):
            session.client.robot.expects_robot = False
        inject_fault(monkeypatch, session, raise_error)
        reply = await session.raw.send_request(request_)
        assert reply == Error(
            request_.id, "an internal fault ended this request: see the server's log"
        )
        monkeypatch.undo()
        assert not session.client.wants_heartbeat(0)  # nothing is pending
        await session.raw.send_request(GetStatusRequest(99))
    assert "injected" in caplog.text


def inject_fault(
    monkeypatch: pytest.MonkeyPatch, session: PeerSession, raise_error: Callable[..., None]
) -> None:
    """Make each step behind the dispatch of a request raise."""
    peer, info = session.client, session.server._context.server_info
    for name in ("post", "readings_reply"):
        monkeypatch.setattr(RobotSession, name, raise_error)
    monkeypatch.setattr(type(info), "find_camera", raise_error)
    monkeypatch.setattr(peer.frame_sender._mailboxes, "get", raise_error)
    for name in (
        "landmarks_reply",
        "StartPosesReply",
        "parts_reply",
        "setup_reply",
        "status_reply",
    ):
        monkeypatch.setattr(peer_module, name, raise_error)


async def test_client_when_it_reads_nothing_for_long_has_stalled_outbox(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(peer_module, "MAX_BLOCKED_S", 0.0)
    async with serve_fake_simulation(FakeSimulation(640, 480)) as server:
        with connect_raw_peer(server.port, high_water_mark=1) as stalled:
            await stalled.send_request(GetStatusRequest(1000))
            (client,) = server.peers
            while client in server.peers:
                await stalled.request_frame()
                server.send_heartbeats()
                await asyncio.sleep(0)


async def test_heartbeats_when_idle_are_due_up_to_a_number_and_when_waiting_always() -> None:
    async with open_session() as session:
        assert [session.client.wants_heartbeat(2) for _ in range(4)] == [True, True, False, False]
        session.client.reset_idle_count()
        assert session.client.wants_heartbeat(2)
        await session.send(StepRequest(2, 0.1))
        assert all(session.client.wants_heartbeat(2) for _ in range(4))
