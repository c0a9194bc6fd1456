"""One client and its robot, with a simulation whose reports the test delivers."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error, Ok, Reply, SensorReports
from catoptra_protocol.stream.requests import (
    DriveRequest,
    GetReadingsRequest,
    GetStatusRequest,
    Request,
    ResetRequest,
    SpawnRequest,
    StepRequest,
)
from catoptra_protocol.usarsim.commands import Drive, GetStartPoses, Init, Step
from catoptra_protocol.usarsim.reports import (
    CommandResult,
    OdometryReading,
    Report,
    StartPoses,
    VehicleStatus,
)
from catoptra_server.simulation import ClientDisconnected, CommandReceived, SimulationEvent
from catoptra_server.transports.stream.stream_peer import StreamPeer
from helpers.fake_simulation import FakeSimulation, serve_fake_simulation
from helpers.loopback import run_scenario
from helpers.stream_peer import RawPeer, connect_raw_peer

SPAWN = SpawnRequest(1, "USARBot.OmniP2AT", "Mine", None, (0.0, 0.0, 0.0), "Centre")
STATUS = VehicleStatus(1.0, 100)
ODOMETRY = OdometryReading("Odometry", 1.0, 2.0, 0.5)


class PeerSession:
    """A raw peer, its StreamPeer in the server, and the posted events."""

    def __init__(self, raw: RawPeer, client: StreamPeer, posted: list[SimulationEvent]) -> None:
        self.raw = raw
        self.client = client
        self.posted = posted

    async def request(self, request: Request, *reports: Report) -> Reply:
        """Send a request; deliver reports after the event of the request; return the reply."""
        before = len(self.posted)
        await self.raw.send(bytes_from_message(request))
        if reports:
            while len(self.posted) == before:
                await self.raw.send_request(GetStatusRequest(next(self.raw.ids)))
            self.client.deliver(reports)
        return (await self.raw.receive())[0]

    async def spawn(self) -> Reply:
        """Spawn a robot; the reply."""
        return await self.request(SPAWN, ODOMETRY, STATUS)


@asynccontextmanager
async def open_session() -> AsyncIterator[PeerSession]:
    simulation = FakeSimulation()
    async with serve_fake_simulation(simulation) as server:
        with connect_raw_peer(server.port) as raw:
            await raw.send_request(GetStatusRequest(1000))
            yield PeerSession(raw, server.peers[0], simulation.posted_events)


def test_spawn_when_successful_returns_the_first_readings() -> None:
    async def scenario() -> None:
        async with open_session() as session:
            reply = await session.spawn()
            init = Init("USARBot.OmniP2AT", "Mine", None, (0.0, 0.0, 0.0), "Centre")
            assert session.posted == [CommandReceived(session.client, init)]
            assert isinstance(reply, SensorReports)
            assert reply.id == 1
            assert [line[:3] for line in reply.reports] == ["SEN", "STA"]

    run_scenario(scenario())


def test_spawn_when_rejected_is_an_error_and_may_be_repeated() -> None:
    async def scenario() -> None:
        async with open_session() as session:
            await session.raw.send(bytes_from_message(SPAWN))
            while not session.posted:
                await session.raw.send_request(GetStatusRequest(next(session.raw.ids)))
            session.client.reject_init()
            reply, _ = await session.raw.receive()
            assert isinstance(reply, Error)
            assert "unknown class" in reply.reason
            assert isinstance(await session.spawn(), SensorReports)

    run_scenario(scenario())


def test_spawn_when_there_is_a_robot_or_a_name_that_breaks_lines_is_an_error() -> None:
    async def scenario() -> None:
        async with open_session() as session:
            for name, expected_reason in (("a}b", "braces"), ("a" * 257, "256 characters")):
                bad = SpawnRequest(2, "USARBot.OmniP2AT", name, None, (0.0, 0.0, 0.0), "Centre")
                reply = await session.request(bad)
                assert isinstance(reply, Error)
                assert expected_reason in reply.reason
            await session.spawn()
            reply = await session.request(SPAWN)
            assert isinstance(reply, Error)
            assert "reset first" in reply.reason

    run_scenario(scenario())


def test_drive_with_a_robot_is_posted_and_without_one_an_error() -> None:
    async def scenario() -> None:
        async with open_session() as session:
            drive = DriveRequest(5, 1.0, None, True)
            reply = await session.request(drive)
            assert isinstance(reply, Error)
            assert "spawn one first" in reply.reason
            await session.spawn()
            assert await session.request(drive) == Ok(5)
            assert session.posted[-1] == CommandReceived(session.client, Drive(1.0, None, True))

    run_scenario(scenario())


def test_step_when_successful_returns_the_cycle_and_when_failed_the_reason() -> None:
    async def scenario() -> None:
        async with open_session() as session:
            succeeded = CommandResult(1.2, "Step", "Clock", "OK")
            reply = await session.request(StepRequest(6, 0.2), ODOMETRY, succeeded)
            assert session.posted == [CommandReceived(session.client, Step(0.2))]
            assert isinstance(reply, SensorReports)
            assert [line[:3] for line in reply.reports] == ["SEN", "RES"]
            failed = CommandResult(1.2, "Step", "Clock", "Failed")
            reply = await session.request(StepRequest(7, 0.2), failed)
            assert isinstance(reply, Error)
            assert "--clock lockstep" in reply.reason

    run_scenario(scenario())


def test_step_when_too_many_are_pending_is_an_error() -> None:
    async def scenario() -> None:
        async with open_session() as session:
            for number in range(1, 18):
                await session.raw.send(bytes_from_message(StepRequest(number, 0.1)))
            reply, _ = await session.raw.receive()
            assert isinstance(reply, Error)
            assert reply.id == 17

    run_scenario(scenario())


def test_reset_when_the_removal_is_complete_is_ok_and_old_readings_are_dropped() -> None:
    async def scenario() -> None:
        async with open_session() as session:
            await session.spawn()
            await session.raw.send(bytes_from_message(ResetRequest(8)))
            while len(session.posted) < 3:
                await session.raw.send_request(GetStatusRequest(next(session.raw.ids)))
            assert session.posted[1:] == [
                ClientDisconnected(session.client),
                CommandReceived(session.client, GetStartPoses()),
            ]
            session.client.deliver([STATUS])  # of the removed robot
            session.client.deliver([StartPoses(())])
            assert (await session.raw.receive())[0] == Ok(8)
            reply = await session.request(GetReadingsRequest(9))
            assert isinstance(reply, Error)
            assert isinstance(await session.spawn(), SensorReports)

    run_scenario(scenario())


def test_readings_when_requested_are_the_newest_of_each_sensor() -> None:
    async def scenario() -> None:
        async with open_session() as session:
            await session.spawn()
            session.client.deliver([OdometryReading("Odometry", 7.0, 2.0, 0.5)])
            reply = await session.request(GetReadingsRequest(9))
            assert isinstance(reply, SensorReports)
            odometry, status = reply.reports
            assert "7.0" in odometry
            assert status.startswith("STA")

    run_scenario(scenario())
