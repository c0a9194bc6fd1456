"""The control port over the loopback, with a simulation that only records events."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.usarsim.commands import Drive, GetConf, Init
from catoptra_protocol.usarsim.grammar import Dialect
from catoptra_protocol.usarsim.reports import (
    CommandResult,
    Configuration,
    Greeting,
    InitResult,
    StartPoses,
    VehicleStatus,
    line_from_report,
)
from catoptra_server.serve import tcp_control
from catoptra_server.serve.port import ConnectionLimits
from catoptra_server.serve.tcp_control import serve_control
from catoptra_server.simulation.events import (
    Client,
    ClientDisconnected,
    CommandReceived,
    ResetRequested,
    SimulationEvent,
    StepRequested,
    StepResult,
)
from helpers.legacy_sockets import reset_connection
from helpers.loopback import HOST, abort, connect, connect_without_reading

GREETING = Greeting("BotDeathMatch", "field")
STATUS = VehicleStatus(1.0, 1200)
INIT = b"INIT {ClassName P2AT} {Location 0,0,0}\r\n"


class PostRecorder:
    """Records events, and lets a scenario wait for the next one."""

    def __init__(self, *, has_room: bool = True) -> None:
        self.has_room = has_room
        self._events: asyncio.Queue[SimulationEvent] = asyncio.Queue()

    def __call__(self, event: SimulationEvent) -> bool:
        self._events.put_nowait(event)
        return self.has_room

    @property
    def num_waiting(self) -> int:
        """Number of events that no scenario has taken."""
        return self._events.qsize()

    async def wait_for_event(self) -> SimulationEvent:
        return await self._events.get()

    async def wait_for_client(self) -> Client:
        """Client of the next command."""
        event = await self.wait_for_event()
        assert isinstance(event, CommandReceived)
        return event.client


async def let_loop_run() -> None:
    """Give all callbacks that are due their turn."""
    for _ in range(20):
        await asyncio.sleep(0)


@asynccontextmanager
async def serve_client(
    **options: Any,
) -> AsyncIterator[tuple[PostRecorder, asyncio.StreamReader, asyncio.StreamWriter]]:
    """A control port with the events that it posts, and a client that has been greeted."""
    posted = PostRecorder()
    async with serve_control(HOST, 0, greeting=GREETING, post=posted, **options) as server:
        reader, writer = await connect(server)
        await read_greeting(reader)
        yield posted, reader, writer
        writer.close()


async def read_greeting(reader: asyncio.StreamReader) -> None:
    assert await reader.readline() == line_from_report(GREETING)


@pytest.mark.parametrize("size", [1, 7, 1000])
async def test_commands_in_any_segmentation_are_posted_in_order(size: int) -> None:
    posted = PostRecorder()
    async with serve_control(HOST, 0, greeting=GREETING, post=posted) as server:
        _, writer = await connect(server)
        data = INIT + b"DRIVE {Left 1}\nSTEP {Time 0.2}\r\n"
        for start in range(0, len(data), size):
            writer.write(data[start : start + size])
            await writer.drain()
        commands = [(await posted.wait_for_event()).command for _ in range(2)]  # type: ignore[union-attr] # both are CommandReceived
        assert commands == [Init("P2AT", location_m=(0, 0, 0)), Drive(left=1.0)]
        step = await posted.wait_for_event()
        assert isinstance(step, StepRequested)
        assert step.duration_s == 0.2
        writer.close()


@pytest.mark.parametrize("is_graceful", [True, False])
async def test_client_when_it_disconnects_in_any_way_is_posted_as_disconnected(
    is_graceful: bool,
) -> None:
    posted = PostRecorder()
    async with serve_control(HOST, 0, greeting=GREETING, post=posted) as server:
        reader, writer = await connect(server)
        writer.write(INIT + b"DRIVE {Left 1")
        await read_greeting(reader)
        client = await posted.wait_for_client()
        writer.close() if is_graceful else abort(writer)
        event = await posted.wait_for_event()
        if is_graceful:  # behind the commands so far
            assert isinstance(event, ResetRequested)
            event.reply()
            event = await posted.wait_for_event()
        assert event == ClientDisconnected(client)


async def test_reports_when_delivered_by_another_thread_arrive_complete_and_in_order() -> None:
    posted = PostRecorder()
    async with serve_control(HOST, 0, greeting=GREETING, post=posted) as server:
        reader, writer = await connect(server)
        writer.write(INIT)
        client = await posted.wait_for_client()

        def deliver() -> None:
            for i in range(100):
                client.deliver([STATUS, CommandResult(float(i), "Step", "Clock")])

        thread = threading.Thread(target=deliver)
        thread.start()
        await read_greeting(reader)
        for i in range(100):
            assert await reader.readline() == line_from_report(STATUS)
            assert f"{{Time {i}.0000}}".encode() in await reader.readline()
        thread.join()
        writer.close()


async def test_init_when_rejected_is_answered_and_does_not_swallow_another() -> None:
    async with serve_client() as (posted, reader, writer):
        writer.write(INIT + INIT)
        client = await posted.wait_for_client()
        client.finish_init(InitResult(0.0, failure="no such class"))
        line = b"RES {Time 0.00} {Type Init} {Status Failed} {Reason no such class}\r\n"
        assert await reader.readline() == line
        assert isinstance((await posted.wait_for_event()).command, Init)  # type: ignore[union-attr] # CommandReceived


async def test_init_is_answered_beside_its_first_reports_only_where_the_robot_was_moved() -> None:
    async with serve_client() as (posted, reader, writer):
        writer.write(INIT)
        client = await posted.wait_for_client()
        client.finish_init(InitResult(2.0, "R"))
        client.finish_init(InitResult(3.0, "R", (1.0, 2.0, -0.25)))
        line = b"RES {Time 3.00} {Type Init} {Name R} {Status OK} {Location 1.0000,2.0000,-0.2500}"
        assert await reader.readline() == line + b"\r\n"


@pytest.mark.parametrize(("failure", "status"), [("", "OK"), ("too long", "Failed")])
async def test_step_when_replied_has_readings_and_a_result(failure: str, status: str) -> None:
    async with serve_client() as (posted, reader, writer):
        writer.write(b"STEP {Time 0.5}\n")
        step = await posted.wait_for_event()
        assert isinstance(step, StepRequested)
        step.reply(StepResult(1.5, () if failure else (STATUS,), failure))
        if not failure:
            assert await reader.readline() == line_from_report(STATUS)
        line = f"RES {{Time 1.5000}} {{Type Step}} {{Name Clock}} {{Status {status}}}\r\n"
        assert await reader.readline() == line.encode()


async def test_client_whose_queue_is_full_is_not_read_until_there_is_room() -> None:
    posted = PostRecorder(has_room=False)
    async with serve_control(HOST, 0, greeting=GREETING, post=posted) as server:
        _, writer = await connect(server)
        writer.write(INIT + 2000 * b"DRIVE {Left 1}\n")
        client = await posted.wait_for_client()
        await let_loop_run()
        assert posted.num_waiting == 0
        client.resume_reading()
        await posted.wait_for_event()
        posted.has_room = True
        client.resume_reading()
        for _ in range(2000 - 1):
            await posted.wait_for_event()
        abort(writer)


@pytest.mark.parametrize("is_graceful", [True, False])
async def test_client_whose_queue_is_full_is_noticed_when_it_leaves(
    is_graceful: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tcp_control, "_END_GRACE_S", 0.1)
    posted = PostRecorder(has_room=False)
    async with serve_control(HOST, 0, greeting=GREETING, post=posted) as server:
        end = await connect_without_reading(server)
        # More than one read: what remains in the kernel hides the end of the connection.
        await asyncio.get_running_loop().sock_sendall(end, INIT + 1000 * b"STEP {Time 60}\n")
        client = await posted.wait_for_client()
        if not is_graceful:
            reset_connection(end)
        end.close()
        while (event := await posted.wait_for_event()) != ClientDisconnected(client):
            assert isinstance(event, StepRequested)


async def test_queries_before_a_half_close_are_all_answered() -> None:
    posted = PostRecorder()
    async with serve_control(HOST, 0, greeting=GREETING, post=posted) as server:
        for _ in range(60):
            reader, writer = await connect(server)
            writer.write(b"GETSTARTPOSES\r\n")
            writer.write_eof()
            client = await posted.wait_for_client()
            reset = await posted.wait_for_event()
            assert isinstance(reset, ResetRequested)
            client.deliver([StartPoses(())])
            reset.reply()
            assert (await reader.read()).endswith(b"NFO {StartPoses 0}\r\n")
            writer.close()
            assert await posted.wait_for_event() == ClientDisconnected(client)


async def test_client_after_a_fault_is_disconnected_with_its_last_reports() -> None:
    async with serve_client() as (posted, reader, writer):
        writer.write(INIT)
        client = await posted.wait_for_client()
        client.deliver([STATUS])
        client.disconnect("a sensor failed")
        assert await reader.read() == line_from_report(STATUS)
        assert await posted.wait_for_event() == ClientDisconnected(client)


async def test_controller_may_be_silent_once_it_has_a_robot() -> None:
    posted = PostRecorder()
    limits = ConnectionLimits(idle_timeout_s=0.05)
    async with serve_control(HOST, 0, greeting=GREETING, post=posted, limits=limits) as server:
        (idle, idle_out), (reader, driver) = await connect(server), await connect(server)
        driver.write(INIT)
        client = await posted.wait_for_client()
        client.finish_init(InitResult(0.0, "R"))
        idle_out.write(b"GETSTARTPOSES\n")
        await posted.wait_for_client()
        await idle.read()  # to the end: disconnected
        idle_out.close()
        client.deliver([STATUS])
        await read_greeting(reader)
        assert await reader.readline() == line_from_report(STATUS)
        driver.close()


async def test_flood_of_one_client_leaves_the_loop_to_the_others() -> None:
    posted = PostRecorder()
    async with serve_control(HOST, 0, greeting=GREETING, post=posted) as server:
        _, flooding = await connect(server)
        flooding.write(400_000 * b"DRIVE {Left 1}\n")  # 6 MB, 4 s of parsing
        flood = await posted.wait_for_client()
        reader, writer = await connect(server)
        await read_greeting(reader)
        writer.write(b"GETSTARTPOSES\n")
        client, num_flooded = flood, 0
        while client is flood:
            client, num_flooded = await posted.wait_for_client(), num_flooded + 1
        # Some chunks of 4 KiB, each 270 commands, not all of the flood.
        assert num_flooded < 100_000
        writer.close()
        abort(flooding)


async def test_report_when_invalid_is_skipped_and_the_others_are_sent(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with serve_client() as (posted, reader, writer):
        writer.write(INIT)
        client = await posted.wait_for_client()
        client.deliver([Configuration("X", (("Name", 5000 * "x"),)), STATUS])
        assert await reader.readline() == line_from_report(STATUS)
    assert "clients read at most" in caplog.text
    assert "Traceback" not in caplog.text


@pytest.mark.parametrize(
    "garbage",
    [
        np.random.default_rng(1).bytes(200_000),
        200_000 * b"x",
        100_000 * b"{",
        50_000 * b"{}",
        10_000 * b"INIT {",
    ],
    ids=["random", "no line end", "braces", "empty blocks", "half INITs"],
)
async def test_garbage_when_sent_is_ignored_and_both_connections_stay_usable(
    garbage: bytes,
) -> None:
    posted = PostRecorder()
    async with serve_control(HOST, 0, greeting=GREETING, post=posted) as server:
        (in_, out), (other_in, other_out) = await connect(server), await connect(server)
        out.write(garbage + b"\r\n" + INIT + b"GETCONF {Type Robot}\r\n")
        event = await posted.wait_for_event()
        while not (isinstance(event, CommandReceived) and event.command == GetConf("Robot")):
            event = await posted.wait_for_event()
        event.client.deliver([STATUS])
        await read_greeting(in_)
        assert await in_.readline() == line_from_report(STATUS)
        other_out.write(INIT)
        (await posted.wait_for_client()).deliver([STATUS])
        await read_greeting(other_in)
        assert await other_in.readline() == line_from_report(STATUS)
        out.close()
        other_out.close()


async def test_client_when_it_reads_nothing_misses_sensor_cycles_and_is_then_disconnected() -> None:
    posted = PostRecorder()
    async with serve_control(HOST, 0, greeting=GREETING, post=posted) as server:
        unread = await connect_without_reading(server)
        await asyncio.get_running_loop().sock_sendall(unread, INIT)
        client = await posted.wait_for_client()
        disconnected = asyncio.create_task(posted.wait_for_event())
        for _ in range(2000):  # 16 MB of cycles: most are dropped
            client.deliver(80 * [STATUS])
            await asyncio.sleep(0)
        assert not disconnected.done()
        reply = Configuration("X", (("Name", 4000 * "x"),))
        for _ in range(4000):  # replies are queued up to a limit
            client.deliver([reply])
            await asyncio.sleep(0)
            if disconnected.done():
                break
        assert await disconnected == ClientDisconnected(client)
        unread.close()


async def test_client_when_another_reads_nothing_is_served() -> None:
    posted = PostRecorder()
    async with serve_control(HOST, 0, greeting=GREETING, post=posted) as server:
        unread = await connect_without_reading(server)
        await asyncio.get_running_loop().sock_sendall(unread, INIT)
        blocked = await posted.wait_for_client()
        reader, writer = await connect(server)
        await read_greeting(reader)
        writer.write(INIT)
        client = await posted.wait_for_client()
        for i in range(300):
            blocked.deliver(80 * [STATUS])
            client.deliver([CommandResult(float(i), "Step", "Clock")])
            assert f"{{Time {i}.0000}}".encode() in await reader.readline()
        writer.close()
        unread.close()


async def test_status_when_the_dialect_is_udk_is_in_its_form() -> None:
    posted = PostRecorder()
    async with serve_control(
        HOST, 0, greeting=GREETING, post=posted, dialect=Dialect.UDK
    ) as server:
        reader, writer = await connect(server)
        await reader.readline()
        writer.write(b"GETSTARTPOSES\r\n")
        (await posted.wait_for_client()).deliver([VehicleStatus(1.5, 99)])
        line = await reader.readline()
        writer.close()
    assert line.startswith(b"STA {Time 1.5000} {Battery 99} {Type GroundVehicle}")


async def test_web_page_that_posts_commands_is_disconnected_before_any_is_executed(
    caplog: pytest.LogCaptureFixture,
) -> None:
    posted = PostRecorder()
    async with serve_control(HOST, 0, greeting=GREETING, post=posted) as server:
        reader, writer = await connect(server)
        writer.write(b"POST / HTTP/1.1\r\nHost: x\r\n\r\n" + INIT)
        await read_greeting(reader)
        assert await reader.read() == b""
        assert isinstance(await posted.wait_for_event(), ClientDisconnected)
        assert posted.num_waiting == 0
        writer.close()
    assert [record.levelname for record in caplog.records if "HTTP" in record.message] == [
        "WARNING"
    ]
