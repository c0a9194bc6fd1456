"""One client and its robot, with a simulation whose answers the test gives."""

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
from catoptra_server.simulation import ClientDisconnected, CommandReceived
from catoptra_server.simulation import SimulationEvent as SimulationRequest
from catoptra_server.transports.stream.stream_peer import StreamPeer
from helpers.fake_simulation import FakeSimulation, serve_fake_simulation
from helpers.loopback import run_scenario
from helpers.stream_peer import RawPeer, connect_raw_peer

SPAWN = SpawnRequest(1, "USARBot.OmniP2AT", "Mine", None, (0.0, 0.0, 0.0), "Centre")
STATUS = VehicleStatus(1.0, 100)
ODOMETRY = OdometryReading("Odometry", 1.0, 2.0, 0.5)


class PeerSession:
    """A raw peer, the server's view of it, and what it posted."""

    def __init__(self, raw: RawPeer, client: StreamPeer, posted: list[SimulationRequest]) -> None:
        self.raw = raw
        self.client = client
        self.posted = posted

    async def request(self, request: Request, *reports: Report) -> Reply:
        """Ask; let the simulation deliver reports once it was asked; return the answer."""
        before = len(self.posted)
        await self.raw.send(bytes_from_message(request))
        if reports:
            while len(self.posted) == before:
                await self.raw.send_request(GetStatusRequest(next(self.raw.ids)))
            self.client.deliver(reports)
        return (await self.raw.receive())[0]

    async def spawn(self) -> Reply:
        """Spawn a robot."""
        return await self.request(SPAWN, ODOMETRY, STATUS)


@asynccontextmanager
async def open_session() -> AsyncIterator[PeerSession]:
    record = FakeSimulation()
    async with serve_fake_simulation(record) as server:
        with connect_raw_peer(server.port) as raw:
            await raw.send_request(GetStatusRequest(1000))
            yield PeerSession(raw, server.peers[0], record.posted_events)


def test_spawn_when_the_robot_is_there_reports_its_first_readings() -> None:
    async def scenario() -> None:
        async with open_session() as talk:
            answer = await talk.spawn()
            init = Init("USARBot.OmniP2AT", "Mine", None, (0.0, 0.0, 0.0), "Centre")
            assert talk.posted == [CommandReceived(talk.client, init)]
            assert isinstance(answer, SensorReports)
            assert answer.id == 1
            assert [line[:3] for line in answer.reports] == ["SEN", "STA"]

    run_scenario(scenario())


def test_spawn_when_refused_says_so_and_may_be_repeated() -> None:
    async def scenario() -> None:
        async with open_session() as talk:
            await talk.raw.send(bytes_from_message(SPAWN))
            while not talk.posted:
                await talk.raw.send_request(GetStatusRequest(next(talk.raw.ids)))
            talk.client.reject_init()
            answer, _ = await talk.raw.receive()
            assert isinstance(answer, Error)
            assert "unknown class" in answer.reason
            assert isinstance(await talk.spawn(), SensorReports)

    run_scenario(scenario())


def test_spawn_when_there_is_a_robot_or_a_name_that_breaks_lines_is_refused() -> None:
    async def scenario() -> None:
        async with open_session() as talk:
            for name, said in (("a}b", "braces"), ("a" * 257, "256 characters")):
                bad = SpawnRequest(2, "USARBot.OmniP2AT", name, None, (0.0, 0.0, 0.0), "Centre")
                answer = await talk.request(bad)
                assert isinstance(answer, Error)
                assert said in answer.reason
            await talk.spawn()
            answer = await talk.request(SPAWN)
            assert isinstance(answer, Error)
            assert "reset first" in answer.reason

    run_scenario(scenario())


def test_drive_when_there_is_a_robot_is_handed_on_and_refused_without() -> None:
    async def scenario() -> None:
        async with open_session() as talk:
            drive = DriveRequest(5, 1.0, None, True)
            answer = await talk.request(drive)
            assert isinstance(answer, Error)
            assert "spawn one first" in answer.reason
            await talk.spawn()
            assert await talk.request(drive) == Ok(5)
            assert talk.posted[-1] == CommandReceived(talk.client, Drive(1.0, None, True))

    run_scenario(scenario())


def test_step_when_done_reports_the_cycle_and_when_failed_says_why() -> None:
    async def scenario() -> None:
        async with open_session() as talk:
            done = CommandResult(1.2, "Step", "Clock", "OK")
            answer = await talk.request(StepRequest(6, 0.2), ODOMETRY, done)
            assert talk.posted == [CommandReceived(talk.client, Step(0.2))]
            assert isinstance(answer, SensorReports)
            assert [line[:3] for line in answer.reports] == ["SEN", "RES"]
            failed = CommandResult(1.2, "Step", "Clock", "Failed")
            answer = await talk.request(StepRequest(7, 0.2), failed)
            assert isinstance(answer, Error)
            assert "--clock lockstep" in answer.reason

    run_scenario(scenario())


def test_steps_when_too_many_are_on_their_way_are_refused() -> None:
    async def scenario() -> None:
        async with open_session() as talk:
            for number in range(1, 18):
                await talk.raw.send(bytes_from_message(StepRequest(number, 0.1)))
            answer, _ = await talk.raw.receive()
            assert isinstance(answer, Error)
            assert answer.id == 17

    run_scenario(scenario())


def test_reset_when_the_removal_is_over_is_done_and_old_readings_are_dropped() -> None:
    async def scenario() -> None:
        async with open_session() as talk:
            await talk.spawn()
            await talk.raw.send(bytes_from_message(ResetRequest(8)))
            while len(talk.posted) < 3:
                await talk.raw.send_request(GetStatusRequest(next(talk.raw.ids)))
            assert talk.posted[1:] == [
                ClientDisconnected(talk.client),
                CommandReceived(talk.client, GetStartPoses()),
            ]
            talk.client.deliver([STATUS])  # of the robot that is about to leave
            talk.client.deliver([StartPoses(())])
            assert (await talk.raw.receive())[0] == Ok(8)
            answer = await talk.request(GetReadingsRequest(9))
            assert isinstance(answer, Error)
            assert isinstance(await talk.spawn(), SensorReports)

    run_scenario(scenario())


def test_readings_when_asked_for_are_the_newest_of_each_sensor() -> None:
    async def scenario() -> None:
        async with open_session() as talk:
            await talk.spawn()
            talk.client.deliver([OdometryReading("Odometry", 7.0, 2.0, 0.5)])
            answer = await talk.request(GetReadingsRequest(9))
            assert isinstance(answer, SensorReports)
            odometry, status = answer.reports
            assert "7.0" in odometry
            assert status.startswith("STA")

    run_scenario(scenario())
