"""Occupied and free ports, and servers that greet or do not."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import pytest

from catoptra_server.commands.doctor import machine as ports
from catoptra_server.commands.doctor.machine import (
    Level,
    check_ports,
    check_running_server,
    check_view_port,
    exit_status,
)
from catoptra_server.commands.server import VIEW_PORT
from client.scripted_server import serve_script

HOST = "127.0.0.1"


@pytest.fixture
def occupied_port() -> Iterator[int]:
    """A port on which a silent program listens."""
    with socket.create_server((HOST, 0)) as listener:
        yield listener.getsockname()[1]


def test_ports_when_any_free_ones_will_do_have_no_problem() -> None:
    (found,) = check_ports(HOST, {"control": 0, "image": 0})
    assert found.level is Level.OK


def test_port_when_taken_is_a_fault_that_names_the_option(occupied_port: int) -> None:
    (found,) = check_ports(HOST, {"control": 0, "image": occupied_port})
    assert found.level is Level.FAULT
    assert f"image port {occupied_port}" in found.message
    assert "--image-port" in found.remedy


def test_address_when_not_of_this_machine_is_a_fault_that_names_the_option() -> None:
    (found,) = check_ports("192.0.2.1", {"control": 0})  # RFC 5737: no machine's
    assert "--host" in found.remedy


def test_server_when_it_greets_is_found() -> None:
    with serve_script(lambda connection: connection.sendall(b"NFO {Gametype x}\r\n")) as port:
        (found,) = check_running_server(HOST, {"control": port})
    assert found.level is Level.OK


def test_server_when_its_greeting_is_of_another_protocol_is_a_fault() -> None:
    with serve_script(lambda connection: connection.sendall(b"SSH-2.0\r\n")) as port:
        (found,) = check_running_server(HOST, {"control": port})
    assert found.level is Level.FAULT


def test_server_when_no_program_listens_is_a_fault() -> None:
    with socket.socket() as unused:
        unused.bind((HOST, 0))
        port = unused.getsockname()[1]
        assert exit_status(check_running_server(HOST, {"control": port, "image": port})) == 2


def test_view_port_when_taken_is_a_fault_only_if_it_was_requested(
    occupied_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ports, "_DEFAULT_VIEW_PORT", occupied_port)
    (requested,) = check_view_port(HOST, occupied_port)
    (default,) = check_view_port(HOST, None)
    (free,) = check_view_port(HOST, 0)
    assert (requested.level, default.level, free.level) == (Level.FAULT, Level.WARNING, Level.OK)
    assert "--view 0" in requested.remedy


def test_default_view_port_is_that_of_the_server() -> None:
    assert ports._DEFAULT_VIEW_PORT == VIEW_PORT
