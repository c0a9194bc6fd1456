"""The server as a whole: from options to listening sockets, and to an orderly end.

Three threads: one owns the simulation's clock and robots, one the renderer; the calling thread's
asyncio loop owns all sockets. Mailboxes and event queues connect the threads.
"""

from __future__ import annotations

import asyncio
import gc
import logging
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from dataclasses import replace
from functools import partial
from typing import NamedTuple

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.reports import Greeting
from catoptra_server.config.server_file import ServerSettings, resolve_settings
from catoptra_server.config.tile_memory import require_tiles_fit
from catoptra_server.deferred_modules import load_deferred_modules, load_view_modules
from catoptra_server.options import Options
from catoptra_server.runtime.memory import MIB
from catoptra_server.server_threads import ServerThreads
from catoptra_server.startup import StartupConfig, read_startup_config
from catoptra_server.transports.connection_budget import fit_connections
from catoptra_server.transports.listener import Listener, create_listener, wait_for_connection
from catoptra_server.transports.loop_share import LoopShare
from catoptra_server.transports.network_exposure import warn_of_exposure
from catoptra_server.transports.stream.connection_guard import (
    DESCRIPTORS_PER_CONNECTION,
    MAX_CONNECTIONS,
)
from catoptra_server.transports.tcp_control import serve_control
from catoptra_server.transports.tcp_image import ImageOptions, serve_images
from catoptra_server.transports.tcp_server import ConnectionLimits, TcpServer
from catoptra_server.transports.web.web_access import MAX_VIEW_CONNECTIONS, create_web_access

log = logging.getLogger(__name__)


STREAM_PORT = 5005
VIEW_PORT = 5080
# A program that waits for the line of the ports has its first frame 0.05 s later, or 0.1 s where
# modules are loaded meanwhile.
_FIRST_FRAME_TIME_S = 0.25


@dataclass(frozen=True, slots=True)
class ListeningAddress:
    """Address and actual ports of a server that listens."""

    host: str
    """Address of all ports."""
    control_port: int
    """TCP port of the USARSim protocol."""
    image_port: int | None
    """TCP port of the image server; None without one."""
    stream_port: int
    """TCP port of the ZeroMQ stream."""
    view_link: str | None = None
    """Address of the live page for a browser; None without one."""


async def serve(
    options: Options, announce: Callable[[ListeningAddress], None], stop: asyncio.Event
) -> None:
    """Serve until an event is set.

    Args:
        options: the options of the server.
        announce: called once with the addresses, when all ports are open.
        stop: ends the server, also while it starts.

    Raises:
        CatoptraError: if the configuration is wrong, no renderer can run, or a thread failed.
        OSError: if a port cannot be opened.
    """
    startup = await asyncio.to_thread(_read_startup_config, options)
    server = ServerThreads(_apply_accuracy_target(startup, options), options, on_failure=stop.set)
    async with server.run():
        await _open_ports(server, announce, stop)


def _read_startup_config(options: Options) -> StartupConfig:
    """Content of the configuration files, all of whose cameras fit into memory."""
    limit_bytes = options.memory_limit_mib * MIB
    startup = read_startup_config(
        options.robot_files,
        options.world_file,
        options.server_file,
        limit_bytes=limit_bytes,
        is_strict=options.is_strict,
    )
    settings = resolve_settings(startup.server_options, options.server_options)
    require_tiles_fit(startup.robots, settings.multi_view, limit_bytes=limit_bytes)
    return startup


async def _open_ports(
    server: ServerThreads, announce: Callable[[ListeningAddress], None], stop: asyncio.Event
) -> None:
    """Keep all ports open until the stop event is set."""
    host = server.options.host
    await warn_of_exposure(host)
    limits = _make_limits(server.settings)
    async with AsyncExitStack() as open_ports:
        control = await open_ports.enter_async_context(_serve_control_port(server, limits.control))
        image_port = None
        if server.settings.has_images:
            images = await open_ports.enter_async_context(_serve_image_port(server, limits.image))
            image_port = images.port
        stream = open_ports.enter_context(_create_stream_listener(server))
        view = _create_view_listener(server)
        access = None
        if view is not None:
            open_ports.enter_context(view)
            access = create_web_access(host, view)
        # What is loaded now lives as long as the process: a collection that looks at all 65 000
        # objects would stop every thread for 45 ms, two ticks.
        gc.freeze()
        # After the last port: a program that reads the line may connect to any of them at once.
        stream_port = stream.getsockname()[1]
        link = access.link if access is not None else None
        announce(ListeningAddress(host, control.port, image_port, stream_port, link))
        # Clients of stream and page wait in their backlogs meanwhile, as they would for the line.
        await _wait_for_first_frame([stream, *([view] if view else [])], stop)
        if not stop.is_set():
            await asyncio.to_thread(load_deferred_modules, server.options.renderer)
            # See deferred_modules.
            from catoptra_server.stream_port import create_stream_context, serve_stream_port

            context = create_stream_context(server)
            await open_ports.enter_async_context(serve_stream_port(context, stream, limits.stream))
            if view is not None and access is not None and await _load_view(view, stop):
                from catoptra_server.web_port import serve_web_port  # likewise

                await open_ports.enter_async_context(
                    serve_web_port(context, server.startup.scene, view, access, limits.view)
                )
            # Those modules, too.
            gc.freeze()
        await stop.wait()
        log.info("stopping")


async def _wait_for_first_frame(listeners: Sequence[Listener], stop: asyncio.Event) -> None:
    """Wait while a first frame may be under way: not where a client of these ports needs it first,
    nor where the server ends.
    """
    events = [*map(wait_for_connection, listeners), stop.wait()]
    waits = [asyncio.ensure_future(event) for event in events]
    await asyncio.wait(waits, timeout=_FIRST_FRAME_TIME_S, return_when=asyncio.FIRST_COMPLETED)
    for wait in waits:
        wait.cancel()
    await asyncio.gather(*waits, return_exceptions=True)


async def _load_view(view: Listener, stop: asyncio.Event) -> bool:
    """Load the modules of the live page; False if the server ends or cannot load them."""
    loading = asyncio.ensure_future(asyncio.to_thread(load_view_modules))
    stopping = asyncio.ensure_future(stop.wait())
    # A server that ends closes its ports at once, and leaves the thread to its own end.
    await asyncio.wait((loading, stopping), return_when=asyncio.FIRST_COMPLETED)
    stopping.cancel()
    if not loading.done():
        return False
    try:
        loading.result()
    # OSError: no free descriptor. All else is served without the page.
    except (ImportError, OSError) as error:
        log.error("the live page is not served: %s", error)
        view.close()
        return False
    return True


# Parts of the process's descriptors for the connections of control and image port, each, of stream
# and live page.
_TCP_DESCRIPTOR_SHARE = 0.2
_STREAM_DESCRIPTOR_SHARE = 0.5
_VIEW_DESCRIPTOR_SHARE = 0.1


def _serve_control_port(
    server: ServerThreads, limits: ConnectionLimits
) -> AbstractAsyncContextManager[TcpServer]:
    return serve_control(
        server.options.host,
        server.settings.control_port,
        greeting=Greeting("BotDeathMatch", server.startup.world.name),
        dialect=server.options.dialect,
        post=server.simulation.post,
        limits=limits,
    )


def _serve_image_port(
    server: ServerThreads, limits: ConnectionLimits
) -> AbstractAsyncContextManager[TcpServer]:
    settings = server.settings
    return serve_images(
        server.options.host,
        settings.image_port,
        mailboxes=server.mailboxes,
        options=ImageOptions(settings.image_type, settings.legacy_images, settings.multi_view),
        limits=limits,
    )


def _create_stream_listener(server: ServerThreads) -> Listener:
    settings, port = server.settings, server.options.stream_port
    # Scripts of USARSim's time know two ports: with --control-port 0 a second server on the machine
    # would still collide at 5005.
    if port is None:
        port = STREAM_PORT if settings.control_port and settings.image_port else 0
    return create_listener(server.options.host, port, name="stream")


def _create_view_listener(server: ServerThreads) -> Listener | None:
    """Listening socket of the live page; None without one."""
    options, settings = server.options, server.settings
    if not options.has_view:
        return None
    create = partial(create_listener, options.host, name="view")
    if options.view_port is not None:
        return create(options.view_port)
    if not (settings.control_port and settings.image_port and options.stream_port != 0):
        return create(0)
    try:
        return create(VIEW_PORT)
    except OSError as error:
        log.info("the live page takes a free port: %s", error.strerror)
        return create(0)


class _PortLimits(NamedTuple):
    """Limits of the connections to each port."""

    control: ConnectionLimits
    image: ConnectionLimits
    stream: ConnectionLimits
    view: ConnectionLimits


def _make_limits(settings: ServerSettings) -> _PortLimits:
    limits = ConnectionLimits(
        handshake_timeout_s=settings.handshake_timeout_s,
        idle_timeout_s=settings.idle_timeout_s,
        loop_share=LoopShare(),
    )
    fit_tcp = partial(fit_connections, share=_TCP_DESCRIPTOR_SHARE)
    stream = fit_connections(
        MAX_CONNECTIONS,
        share=_STREAM_DESCRIPTOR_SHARE,
        descriptors_each=DESCRIPTORS_PER_CONNECTION,
        name="stream",
    )
    view = fit_connections(MAX_VIEW_CONNECTIONS, share=_VIEW_DESCRIPTOR_SHARE, name="view")
    return _PortLimits(
        replace(limits, max_connections=fit_tcp(settings.max_connections, name="control")),
        replace(limits, max_connections=fit_tcp(settings.max_image_connections, name="image")),
        replace(limits, max_connections=stream),
        replace(limits, max_connections=view),
    )


def _apply_accuracy_target(startup: StartupConfig, options: Options) -> StartupConfig:
    """Start-up configuration with the command line's accuracy target for all cameras."""
    robots = []
    for robot in startup.robots:
        omnis = []
        for omni in robot.omni_cameras:
            target = omni.render_settings.accuracy_target.with_changes(
                max_error_px=options.max_error_px, budget_ms=options.budget_ms
            )
            settings = replace(omni.render_settings, accuracy_target=target)
            omnis.append(replace(omni, render_settings=settings))
        robots.append(replace(robot, omni_cameras=tuple(omnis)))
    return replace(startup, robots=tuple(robots))
