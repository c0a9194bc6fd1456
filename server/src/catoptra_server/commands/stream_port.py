"""The port of the ZeroMQ stream, with all that no other port needs: see `deferred_modules`."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager

from catoptra_server.commands.server import ServerThreads
from catoptra_server.serve.limits import Listener
from catoptra_server.serve.stream.peer import StreamServer, serve_stream
from catoptra_server.serve.stream.replies import StreamContext, build_server_info
from catoptra_server.serve.tcp_server import ConnectionLimits


def create_stream_context(server: ServerThreads) -> StreamContext:
    """What the stream's clients share, on ZeroMQ and on WebSockets."""
    startup = server.startup
    return StreamContext(
        mailboxes=server.mailboxes,
        post=server.simulation.post,
        server_info=build_server_info(
            startup.robots, startup.world, clock=server.options.clock.value, plans=server.plans
        ),
        query_plan=server.render_thread.query_plan,
    )


def serve_stream_port(
    context: StreamContext, listener: Listener, limits: ConnectionLimits
) -> AbstractAsyncContextManager[StreamServer]:
    """Serve the stream on a listening socket, for the length of a block."""
    return serve_stream(listener, context, limits=limits)
