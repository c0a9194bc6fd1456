"""Check of ports: free before the server starts, or served while it runs."""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterator, Mapping

from catoptra_server.doctor.finding import Finding, fault, ok, warning

# First bytes of USARSim's greeting line, which the control port sends without a request.
_GREETING = b"NFO"
_TIMEOUT_S = 2.0
# That of `app.VIEW_PORT`, whose module would load the whole server.
_DEFAULT_VIEW_PORT = 5080


def check_ports(host: str, ports: Mapping[str, int]) -> Iterator[Finding]:
    """Yield whether the server can listen on each port.

    Args:
        host: address on which the server will listen.
        ports: port by the name of its option, such as control; 0 = any free one.
    """
    problems = [
        problem for name, port in ports.items() for problem in _check_port(host, name, port)
    ]
    if not problems:
        listed = ", ".join(f"{name} {port or 'any'}" for name, port in ports.items())
        yield ok("ports", f"free on {host}: {listed}")
    yield from problems


def check_view_port(host: str, port: int | None) -> Iterator[Finding]:
    """Yield whether the server can listen on the port of the live page.

    Args:
        host: address on which the server will listen.
        port: requested port, 0 = any free one; None for the default, which may be in use.
    """
    wanted = _DEFAULT_VIEW_PORT if port is None else port
    try:
        socket.create_server((host, wanted)).close()
    except OSError as error:
        message = f"view port {wanted} on {host}: {_error_text(error)}"
        if port is None:
            remedy = "the server takes a free port and prints it; --view 0 or --no-view"
            yield warning("live page", message, remedy=remedy)
        else:
            yield fault("live page", message, remedy="take a free port: --view 0, or --no-view")
    else:
        yield ok("live page", f"port {wanted or 'any'} is free on {host}")


def _check_port(host: str, name: str, port: int) -> Iterator[Finding]:
    # A real attempt, with SO_REUSEADDR as the server's own sockets have: a connection attempt would
    # take a firewalled port for a free one.
    try:
        socket.create_server((host, port)).close()
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            remedy = f"end the program that listens there, or take a free port: --{name}-port 0"
        elif isinstance(error, PermissionError):
            remedy = f"ports below 1024 need privileges: choose another --{name}-port"
        else:
            remedy = "--host is an address of this machine: 127.0.0.1, or 0.0.0.0 for all"
        yield fault("ports", f"{name} port {port} on {host}: {_error_text(error)}", remedy=remedy)


def check_running_server(host: str, ports: Mapping[str, int]) -> Iterator[Finding]:
    """Yield whether a server accepts connections on each port and greets on the control port."""
    for name, port in ports.items():
        try:
            with socket.create_connection((host, port), timeout=_TIMEOUT_S) as connection:
                if name == "control" and connection.recv(len(_GREETING)) != _GREETING:
                    raise OSError("no USARSim greeting was received")
        except OSError as error:
            remedy = "the server's log has the reason; start the server again"
            yield fault(name, f"no server at {host}:{port}: {_error_text(error)}", remedy=remedy)
        else:
            # The image port is silent until a request: an accepted connection has to do.
            yield ok(name, f"a server answers at {host}:{port}")


def _error_text(error: Exception) -> str:
    # strerror without the number in brackets; a timeout has none.
    text: str = getattr(error, "strerror", None) or str(error)
    return text
