"""The port of the live page, with all that no other port needs: see `deferred_modules`."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager

from catoptra_server.serve.limits import Listener
from catoptra_server.serve.stream.replies import StreamContext
from catoptra_server.serve.tcp_server import ConnectionLimits
from catoptra_server.serve.web.pages import WebPages, read_page_files
from catoptra_server.serve.web.web_access import WebAccess
from catoptra_server.serve.web.web_server import WebServer, serve_web
from catoptra_server.world.scene_mesh import SceneMesh


def serve_web_port(
    context: StreamContext,
    scene: SceneMesh,
    listener: Listener,
    access: WebAccess,
    limits: ConnectionLimits,
) -> AbstractAsyncContextManager[WebServer]:
    """Serve the live page on a listening socket, for the length of a block."""
    pages = WebPages(read_page_files(), context.server_info, scene)
    return serve_web(listener, context, pages, access=access, limits=limits)
