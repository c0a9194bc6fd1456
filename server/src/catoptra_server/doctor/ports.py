"""Ports: whether the server's are free before it runs, and whether it answers while it does."""

from __future__ import annotations

import errno
import socket
from collections.abc import Iterator, Mapping

from catoptra_server.doctor.finding import Finding, fault, ok

_GREETING = b"NFO"
_TIMEOUT_S = 2.0


def check_ports(host: str, ports: Mapping[str, int]) -> Iterator[Finding]:
    """Yield whether each port can be listened on; 0 stands for any free one. Names as --options."""
    problems = [
        problem for name, port in ports.items() for problem in _check_port(host, name, port)
    ]
    if not problems:
        listed = ", ".join(f"{name} {port or 'any'}" for name, port in ports.items())
        yield ok("ports", f"free on {host}: {listed}")
    yield from problems


def _check_port(host: str, name: str, port: int) -> Iterator[Finding]:
    try:
        socket.create_server((host, port)).close()
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            remedy = f"end who listens there, or take another: --{name}-port 0 takes a free one"
        elif isinstance(error, PermissionError):
            remedy = f"ports below 1024 are the system's: choose another --{name}-port"
        else:
            remedy = "--host takes an address of this machine: 127.0.0.1, or 0.0.0.0 for all"
        yield fault("ports", f"{name} port {port} on {host}: {_error_text(error)}", remedy=remedy)


def check_running_server(host: str, ports: Mapping[str, int]) -> Iterator[Finding]:
    """Yield whether a server that should be running does: it greets, and takes connections."""
    for name, port in ports.items():
        try:
            with socket.create_connection((host, port), timeout=_TIMEOUT_S) as connection:
                if name == "control" and connection.recv(len(_GREETING)) != _GREETING:
                    raise OSError("it does not greet as a server of USARSim's does")
        except OSError as error:
            remedy = "its log tells why it ended or stands still; start it again"
            yield fault(name, f"no server at {host}:{port}: {_error_text(error)}", remedy=remedy)
        else:
            yield ok(name, f"a server answers at {host}:{port}")


def _error_text(error: Exception) -> str:
    reason: str = getattr(error, "strerror", None) or str(error)
    return reason
