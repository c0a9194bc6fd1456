"""The server in this process: threads, start, end, and what is loaded when."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import re
import socket
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.usarsim.commands import Init
from catoptra_server.commands import server as server_module
from catoptra_server.commands.server import ListeningAddress, Options, ServerThreads, serve
from catoptra_server.config.server_file import ServerOptions
from catoptra_server.config.startup import read_startup_config
from catoptra_server.effects.medium.misalignment import lookup_maps
from catoptra_server.frames.frame import CameraChannel
from catoptra_server.frames.renderers import RendererChoice
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.worker_thread import ThreadFailedError
from catoptra_server.simulation.events import CommandReceived
from catoptra_server.simulation.loop import ClockMode, Simulation
from helpers.configs import Edit, write_edited_copy, write_small_world
from helpers.deadline import Deadline
from helpers.loopback import DEADLINE_S, HOST
from helpers.robots import FakeClient, FakeView
from helpers.server_process import write_small_robot


def make_threads(robot_file: Path, folder: Path, clock: ClockMode) -> ServerThreads:
    options = Options(
        robot_files=(robot_file,),
        world_file=write_small_world(folder),
        server_options=ServerOptions(control_port=0, image_port=0),
        renderer="trace",
        threads=1,
        clock=clock,
    )
    startup = read_startup_config(options.robot_files, options.world_file, None)
    return ServerThreads(startup, options, on_failure=lambda: pytest.fail("a thread failed"))


@pytest.mark.parametrize("clock", ClockMode)
async def test_frame_of_a_spawned_robot_arrives_in_its_mailbox(
    tmp_path: Path, clock: ClockMode
) -> None:
    threads, client = make_threads(write_small_robot(tmp_path), tmp_path, clock), FakeClient()
    async with threads.run():
        threads.simulation.post(CommandReceived(client, Init("OmniP2AT", "R", (0.0, 0.0, 0.0))))
        mailbox = threads.mailboxes.get(CameraChannel("", ""))
        frame = await mailbox.wait_for_newer(0)
    assert (frame.metadata.robot, frame.plan) == ("R", *threads.plans.values())
    assert client.spawns == [("R", None)]


async def test_plans_of_a_server_without_cameras_are_none(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    robot_file = write_small_robot(tmp_path)
    write_edited_copy(robot_file, tmp_path, Edit('ItemName="OmniCam",', 'ItemName="",'))
    threads = make_threads(robot_file, tmp_path, ClockMode.LOCKSTEP)
    with caplog.at_level("INFO"):
        async with threads.run():
            pass
    assert threads.plans == {}
    assert "no renderer is started" in caplog.text


def make_threads_with_effect(folder: Path) -> ServerThreads:
    robot_file = write_edited_copy(
        write_small_robot(folder),
        folder,
        Edit("ResolutionX=64", "ResolutionX=64\nMisalignment=auto\nMisalignmentX=0.0003"),
    )
    return make_threads(robot_file, folder, ClockMode.LOCKSTEP)


async def test_maps_of_effects_are_kept_before_the_start_ends(tmp_path: Path) -> None:
    lookup_maps.cache_clear()
    threads = make_threads_with_effect(tmp_path)
    async with threads.run():
        assert lookup_maps.cache_info().currsize == 1
        assert not any(thread.name.startswith("effects") for thread in threading.enumerate())


async def test_fault_of_a_map_at_the_start_is_left_to_the_frames_that_need_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise DomainError("injected")

    monkeypatch.setattr(server_module, "plan_effects", fail)
    threads = make_threads_with_effect(tmp_path)
    async with threads.run():
        assert threads.plans


def make_options(folder: Path, *, clock: ClockMode = ClockMode.LOCKSTEP) -> Options:
    return Options(
        robot_files=(write_small_robot(folder),),
        world_file=write_small_world(folder),
        server_options=ServerOptions(control_port=0, image_port=0),
        renderer="trace",
        threads=1,
        clock=clock,
    )


@asynccontextmanager
async def serve_for(options: Options) -> AsyncIterator[tuple[ListeningAddress, asyncio.Event]]:
    """Serve until the block ends or sets the event; a failure of the server is raised then."""
    listening: asyncio.Future[ListeningAddress] = asyncio.get_running_loop().create_future()
    stop = asyncio.Event()
    server = asyncio.create_task(serve(options, listening.set_result, stop))
    await asyncio.wait({server, listening}, return_when=asyncio.FIRST_COMPLETED)
    if not server.done():
        try:
            yield listening.result(), stop
        finally:
            stop.set()
    await server


@pytest.mark.parametrize("clock", ClockMode)
async def test_server_when_stopped_ends_also_with_clients_connected(
    tmp_path: Path, clock: ClockMode
) -> None:
    async with serve_for(make_options(tmp_path, clock=clock)) as (address, stop):
        reader, writer = await asyncio.open_connection(HOST, address.control_port)
        viewer, requests = await asyncio.open_connection(HOST, address.image_port)
        writer.write(b"INIT {ClassName OmniP2AT} {Location 0,0,0}\r\n")
        requests.write(100 * b"OK")
        await viewer.readexactly(5)
        stop.set()
        while await reader.read(1000):
            pass  # until the server closes the connection
        writer.close()
        requests.close()


class _FakeRenderer:
    """A renderer of one view, which records its end."""

    def __init__(self, view: FakeView) -> None:
        self.view = view
        self.closed = False

    def describe(self) -> str:
        return "fake"

    def prepare(self, camera: object, plan: object) -> FakeView:
        return self.view

    def close(self) -> None:
        self.closed = True


def use_renderer(monkeypatch: pytest.MonkeyPatch, view: FakeView) -> _FakeRenderer:
    renderer = _FakeRenderer(view)
    choice = RendererChoice(renderer, RendererKind.TRACE, "fake")  # type: ignore[arg-type] # fake enough
    monkeypatch.setattr(server_module, "choose_renderer", lambda *args, **kwargs: choice)
    return renderer


async def test_server_when_a_thread_fails_ends_with_the_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: Simulation, on_ready: Callable[[], None]) -> None:
        on_ready()
        raise ZeroDivisionError("the clock stands still")

    renderer = use_renderer(monkeypatch, FakeView())
    monkeypatch.setattr(Simulation, "run", fail)
    with pytest.raises(ThreadFailedError, match=r"simulation thread failed: .*the clock stands"):
        async with serve_for(make_options(tmp_path)) as (_, stop):
            await stop.wait()
    assert renderer.closed


async def test_renderer_when_the_server_ends_is_closed_with_its_view(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    renderer = use_renderer(monkeypatch, FakeView())
    async with serve_for(make_options(tmp_path)):
        pass
    assert renderer.closed
    assert renderer.view.is_closed


async def test_server_warns_of_its_host_before_it_listens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hosts: list[str] = []

    async def record(host: str) -> None:
        hosts.append(host)

    use_renderer(monkeypatch, FakeView())
    monkeypatch.setattr(server_module, "warn_of_exposure", record)
    async with serve_for(make_options(tmp_path)) as (address, _):
        assert hosts == [address.host]


async def test_server_when_no_renderer_can_run_does_not_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def reject(*args: object, **kwargs: object) -> RendererChoice:
        raise DomainError("no renderer today")

    monkeypatch.setattr(server_module, "choose_renderer", reject)
    with pytest.raises(DomainError, match="no renderer today"):
        async with serve_for(make_options(tmp_path)):
            raise AssertionError("the server listens without a renderer")


async def test_robot_when_it_has_no_camera_is_served_with_black_frames(tmp_path: Path) -> None:
    options = make_options(tmp_path)
    blind = write_edited_copy(
        options.robot_files[0], tmp_path, Edit('ItemName="OmniCam",', 'ItemName="",')
    )
    assert blind == options.robot_files[0]
    async with serve_for(options) as (address, _):
        viewer, requests = await asyncio.open_connection(HOST, address.image_port)
        requests.write(b"OK")
        assert (await viewer.readexactly(5))[:1] == b"\x02"
        requests.close()


async def test_images_when_switched_off_are_not_served(tmp_path: Path) -> None:
    options = make_options(tmp_path)
    server_options = ServerOptions(control_port=0, has_images=False)
    async with serve_for(
        dataclasses.replace(options, server_options=server_options, stream_port=0)
    ) as (address, _):
        assert address.image_port is None
        assert address.control_port


async def test_controllers_beyond_the_maximum_are_rejected_until_one_disconnects(
    tmp_path: Path,
) -> None:
    ini = tmp_path / "server.ini"
    ini.write_text("[USARBotAPI.BotServer]\nListenPort=3000\nMaxConnections=1\n")
    async with serve_for(dataclasses.replace(make_options(tmp_path), server_file=ini)) as (
        address,
        _,
    ):
        first = await asyncio.open_connection(HOST, address.control_port)
        assert (await first[0].readline()).startswith(b"NFO ")
        # Without a command it would make room for the second.
        first[1].write(b"GETSTARTPOSES\r\n")
        assert (await first[0].readline()).startswith(b"NFO {StartPoses")
        second = await asyncio.open_connection(HOST, address.control_port)
        assert await second[0].read() == b""
        first[1].close()
        deadline = Deadline("greeting after a disconnect", DEADLINE_S)
        while not await receives_greeting(address.control_port):
            deadline.check()
        second[1].close()


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="no IPv6 on this machine")
async def test_all_ports_on_all_ipv6_addresses_accept_ipv4_too(tmp_path: Path) -> None:
    async with serve_for(dataclasses.replace(make_options(tmp_path), host="::")) as (address, _):
        assert address.image_port is not None
        for port in (address.control_port, address.image_port, address.stream_port):
            _, writer = await asyncio.open_connection(HOST, port)
            writer.close()


async def test_timeouts_hold_for_control_and_image_port(tmp_path: Path) -> None:
    options = make_options(tmp_path)
    limited = options.server_options | ServerOptions(handshake_timeout_s=0.1)
    async with serve_for(dataclasses.replace(options, server_options=limited)) as (address, _):
        for port in (address.control_port, address.image_port):
            reader, writer = await asyncio.open_connection(HOST, port)
            await reader.read()  # to the end: without a command or request it is closed
            writer.close()


async def receives_greeting(port: int) -> bool:
    """Whether a new connection receives the greeting."""
    reader, writer = await asyncio.open_connection(HOST, port)
    line = await reader.readline()
    writer.close()
    return bool(line)


async def test_stream_client_when_it_connects_before_the_stream_is_loaded_is_served(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    connected = threading.Event()
    use_renderer(monkeypatch, FakeView())
    # Without the connection it would wait for ever.
    monkeypatch.setattr(server_module, "_FIRST_FRAME_TIME_S", None)
    monkeypatch.setattr(
        server_module, "load_deferred_modules", lambda *_, **__: connected.wait(DEADLINE_S)
    )
    async with serve_for(make_options(tmp_path)) as (address, _):
        reader, writer = await asyncio.open_connection(HOST, address.stream_port)
        connected.set()
        # The first byte of a greeting of ZeroMQ.
        assert await reader.readexactly(1) == b"\xff"
        writer.close()


@pytest.mark.parametrize("is_stopped", [False, True])
async def test_modules_are_loaded_soon_without_a_client_unless_the_server_is_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_stopped: bool
) -> None:
    loaded = threading.Event()
    use_renderer(monkeypatch, FakeView())
    if is_stopped:
        # Else the time might pass before the stop.
        monkeypatch.setattr(server_module, "_FIRST_FRAME_TIME_S", None)
    monkeypatch.setattr(server_module, "load_deferred_modules", lambda *_, **__: loaded.set())
    async with serve_for(make_options(tmp_path)):
        assert is_stopped or await asyncio.to_thread(loaded.wait, DEADLINE_S)
    assert loaded.is_set() is not is_stopped


async def test_page_when_its_default_port_is_in_use_takes_a_free_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    use_renderer(monkeypatch, FakeView())
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.create_server((HOST, 0))) for _ in range(3)]
        port, control_port, stream_port = (one.getsockname()[1] for one in sockets)
        for spare in sockets[1:]:
            spare.close()
        monkeypatch.setattr(server_module, "VIEW_PORT", port)
        options = dataclasses.replace(
            make_options(tmp_path),
            server_options=ServerOptions(control_port=control_port, has_images=False),
            stream_port=stream_port,
        )
        caplog.set_level("INFO")
        async with serve_for(options) as (address, _):
            link = address.view_link
    assert link is not None
    assert not link.endswith(f":{port}/")
    assert "the live page takes a free port" in caplog.text


@pytest.mark.parametrize(
    ("changes", "pattern"),
    [
        ({"has_view": False}, None),
        ({"view_port": 0}, r"http://127\.0\.0\.1:\d+/"),
        ({"host": "0.0.0.0"}, r"http://localhost:\d+/\?token=[\w-]{43}"),
    ],
)
async def test_link_of_the_page_is_announced_where_it_is_served(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any], pattern: str | None
) -> None:
    use_renderer(monkeypatch, FakeView())
    async with serve_for(dataclasses.replace(make_options(tmp_path), **changes)) as (address, _):
        link = address.view_link
    assert (link is None) is (pattern is None)
    assert pattern is None or re.fullmatch(pattern, link or "")


async def connect_for_ever(port: int) -> None:
    while True:
        _, writer = await asyncio.open_connection(HOST, port)
        writer.close()


async def test_server_that_cannot_load_the_page_serves_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail() -> None:
        raise ImportError("injected")

    use_renderer(monkeypatch, FakeView())
    monkeypatch.setattr(server_module, "load_view_modules", fail)
    async with serve_for(make_options(tmp_path)) as (address, _):
        port = int((address.view_link or "").rstrip("/").rpartition(":")[2])
        with pytest.raises(ConnectionError):
            await connect_for_ever(port)
        reader, writer = await asyncio.open_connection(HOST, address.stream_port)
        assert await reader.read(1)  # the stream's greeting
        writer.close()
    assert "the live page is not served: injected" in caplog.text


async def test_server_that_ends_does_not_wait_until_the_page_is_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_loading, may_end = threading.Event(), threading.Event()

    def load() -> None:
        is_loading.set()
        may_end.wait(DEADLINE_S)

    use_renderer(monkeypatch, FakeView())
    monkeypatch.setattr(server_module, "load_view_modules", load)
    async with serve_for(make_options(tmp_path)):
        assert await asyncio.to_thread(is_loading.wait, DEADLINE_S)
    assert not may_end.is_set()
    may_end.set()


# A process of its own: this one has loaded nearly all modules already.
SCRIPT = """
import json, sys
from catoptra_server.commands.serve import main
from catoptra_server.commands.server import load_deferred_modules, load_view_modules
before = sorted(sys.modules)
load_deferred_modules(sys.argv[1])
if sys.argv[2] == "view":
    load_view_modules()
print(json.dumps([before, sorted(sys.modules)]))
"""
STREAM = {"zmq", "msgpack", "catoptra_server.serve.stream.peer"}
RASTER = {"moderngl", "catoptra_server.render.raster.raster_renderer"}


VIEW = {"aiohttp", "catoptra_server.serve.web.web_server"}


def list_modules(renderer: str, view: str = "view") -> tuple[set[str], set[str]]:
    """Modules loaded for a start, and those after the deferred ones."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, renderer, view], check=True, capture_output=True, text=True
    )
    before, after = json.loads(done.stdout)
    return set(before), set(after)


@pytest.mark.parametrize(("renderer", "deferred"), [("auto", STREAM | RASTER), ("trace", STREAM)])
def test_modules_of_stream_and_second_renderer_are_loaded_after_the_start(
    renderer: str, deferred: set[str]
) -> None:
    before, after = list_modules(renderer)
    assert not before & (STREAM | RASTER)
    assert after & (STREAM | RASTER) == deferred


@pytest.mark.parametrize(("view", "deferred"), [("view", VIEW), ("no view", set())])
def test_modules_of_the_page_are_loaded_after_the_start_where_it_is_served(
    view: str, deferred: set[str]
) -> None:
    before, after = list_modules("trace", view)
    assert not before & VIEW
    assert after & VIEW == deferred
