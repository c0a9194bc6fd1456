"""One client and its robot, with a simulation whose answers the test gives."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from catoptra_protocol.wire.commands import Drive, GetStartPoses, Init, Step
from catoptra_protocol.wire.reports import (
    OdometryReading,
    Report,
    Result,
    StartPoses,
    VehicleStatus,
)
from catoptra_protocol.wire.stream import bytes_from_message
from catoptra_protocol.wire.stream_answers import Answer, Done, Refused, Reported
from catoptra_protocol.wire.stream_requests import (
    AskDrive,
    AskReadings,
    AskReset,
    AskSpawn,
    AskStatus,
    AskStep,
    Request,
)
from catoptra_server.simulation import Asked, Left
from catoptra_server.simulation import Request as SimulationRequest
from catoptra_server.transports.zmq_stream_peer import StreamPeer
from helpers.loopback import play
from helpers.stream_peer import RawPeer, raw_peer
from helpers.stream_scene import Scene, streaming

SPAWN = AskSpawn(1, "USARBot.OmniP2AT", "Mine", None, (0.0, 0.0, 0.0), "Centre")
STATUS = VehicleStatus(1.0, 100)
ODOMETRY = OdometryReading("Odometry", 1.0, 2.0, 0.5)


class Conversation:
    """A raw peer, the server's view of it, and what it posted."""

    def __init__(self, raw: RawPeer, client: StreamPeer, posted: list[SimulationRequest]) -> None:
        self.raw = raw
        self.client = client
        self.posted = posted

    async def ask(self, request: Request, *reports: Report) -> Answer:
        """Ask; let the simulation deliver reports once it was asked; return the answer."""
        before = len(self.posted)
        await self.raw.send(bytes_from_message(request))
        if reports:
            while len(self.posted) == before:
                await self.raw.ask(AskStatus(next(self.raw.ids)))
            self.client.deliver(reports)
        return (await self.raw.receive())[0]

    async def spawned(self) -> Answer:
        """Spawn a robot."""
        return await self.ask(SPAWN, ODOMETRY, STATUS)


@asynccontextmanager
async def conversation() -> AsyncIterator[Conversation]:
    record = Scene()
    async with streaming(record) as server:
        with raw_peer(server.port) as raw:
            await raw.ask(AskStatus(1000))
            yield Conversation(raw, server.peers[0], record.posted)


def test_spawn_when_the_robot_is_there_reports_its_first_readings() -> None:
    async def scene() -> None:
        async with conversation() as talk:
            answer = await talk.spawned()
            init = Init("USARBot.OmniP2AT", "Mine", None, (0.0, 0.0, 0.0), "Centre")
            assert talk.posted == [Asked(talk.client, init)]
            assert isinstance(answer, Reported)
            assert answer.id == 1
            assert [line[:3] for line in answer.reports] == ["SEN", "STA"]

    play(scene())


def test_spawn_when_refused_says_so_and_may_be_repeated() -> None:
    async def scene() -> None:
        async with conversation() as talk:
            await talk.raw.send(bytes_from_message(SPAWN))
            while not talk.posted:
                await talk.raw.ask(AskStatus(next(talk.raw.ids)))
            talk.client.refuse_init()
            answer, _ = await talk.raw.receive()
            assert isinstance(answer, Refused)
            assert "unknown class" in answer.reason
            assert isinstance(await talk.spawned(), Reported)

    play(scene())


def test_spawn_when_there_is_a_robot_or_a_name_that_breaks_lines_is_refused() -> None:
    async def scene() -> None:
        async with conversation() as talk:
            for name, said in (("a}b", "braces"), ("a" * 257, "256 characters")):
                bad = AskSpawn(2, "USARBot.OmniP2AT", name, None, (0.0, 0.0, 0.0), "Centre")
                answer = await talk.ask(bad)
                assert isinstance(answer, Refused)
                assert said in answer.reason
            await talk.spawned()
            answer = await talk.ask(SPAWN)
            assert isinstance(answer, Refused)
            assert "reset first" in answer.reason

    play(scene())


def test_drive_when_there_is_a_robot_is_handed_on_and_refused_without() -> None:
    async def scene() -> None:
        async with conversation() as talk:
            drive = AskDrive(5, 1.0, None, True)
            answer = await talk.ask(drive)
            assert isinstance(answer, Refused)
            assert "spawn one first" in answer.reason
            await talk.spawned()
            assert await talk.ask(drive) == Done(5)
            assert talk.posted[-1] == Asked(talk.client, Drive(1.0, None, True))

    play(scene())


def test_step_when_done_reports_the_cycle_and_when_failed_says_why() -> None:
    async def scene() -> None:
        async with conversation() as talk:
            done = Result(1.2, "Step", "Clock", "OK")
            answer = await talk.ask(AskStep(6, 0.2), ODOMETRY, done)
            assert talk.posted == [Asked(talk.client, Step(0.2))]
            assert isinstance(answer, Reported)
            assert [line[:3] for line in answer.reports] == ["SEN", "RES"]
            failed = Result(1.2, "Step", "Clock", "Failed")
            answer = await talk.ask(AskStep(7, 0.2), failed)
            assert isinstance(answer, Refused)
            assert "--clock lockstep" in answer.reason

    play(scene())


def test_steps_when_too_many_are_on_their_way_are_refused() -> None:
    async def scene() -> None:
        async with conversation() as talk:
            for number in range(1, 18):
                await talk.raw.send(bytes_from_message(AskStep(number, 0.1)))
            answer, _ = await talk.raw.receive()
            assert isinstance(answer, Refused)
            assert answer.id == 17

    play(scene())


def test_reset_when_the_removal_is_over_is_done_and_old_readings_are_dropped() -> None:
    async def scene() -> None:
        async with conversation() as talk:
            await talk.spawned()
            await talk.raw.send(bytes_from_message(AskReset(8)))
            while len(talk.posted) < 3:
                await talk.raw.ask(AskStatus(next(talk.raw.ids)))
            assert talk.posted[1:] == [Left(talk.client), Asked(talk.client, GetStartPoses())]
            talk.client.deliver([STATUS])  # of the robot that is about to leave
            talk.client.deliver([StartPoses(())])
            assert (await talk.raw.receive())[0] == Done(8)
            answer = await talk.ask(AskReadings(9))
            assert isinstance(answer, Refused)
            assert isinstance(await talk.spawned(), Reported)

    play(scene())


def test_readings_when_asked_for_are_the_newest_of_each_sensor() -> None:
    async def scene() -> None:
        async with conversation() as talk:
            await talk.spawned()
            talk.client.deliver([OdometryReading("Odometry", 7.0, 2.0, 0.5)])
            answer = await talk.ask(AskReadings(9))
            assert isinstance(answer, Reported)
            odometry, status = answer.reports
            assert "7.0" in odometry
            assert status.startswith("STA")

    play(scene())
