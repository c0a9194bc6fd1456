"""The port of the ZeroMQ stream, with all that no other port needs: see `deferred_modules`."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager

from catoptra_server.server_threads import ServerThreads
from catoptra_server.transports.listener import Listener
from catoptra_server.transports.stream.server_info import build_server_info
from catoptra_server.transports.stream.stream_server import StreamServer, serve_stream
from catoptra_server.transports.tcp_server import ConnectionLimits


def serve_stream_port(
    server: ServerThreads, listener: Listener, limits: ConnectionLimits
) -> AbstractAsyncContextManager[StreamServer]:
    """Serve the stream of a server, on a listening socket, for the length of a block."""
    startup = server.startup
    return serve_stream(
        listener,
        mailboxes=server.mailboxes,
        post=server.simulation.post,
        server_info=build_server_info(
            startup.robots, startup.world, clock=server.options.clock.value, plans=server.plans
        ),
        query_plan=server.render_thread.query_plan,
        limits=limits,
    )
