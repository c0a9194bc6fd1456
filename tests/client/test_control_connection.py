"""The control connection: opening, waiting, losing it."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from catoptra_client.control_connection import (
    ControlConnection,
    ReplyTimeoutError,
    open_connection,
    peer_address,
)
from catoptra_protocol.errors import ConnectionLostError
from catoptra_protocol.usarsim.commands import GetStartPoses
from catoptra_protocol.usarsim.reports import OdometryReading, StartPoses, VehicleStatus
from client.scripted_server import Script, ScriptedControlPeer, serve_script, wait_for_close


def test_connection_when_open_sends_at_once_and_names_the_peer() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with open_connection("127.0.0.1", port, 5.0, server_kind="image") as connection:
            assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
            assert peer_address(connection) == f"127.0.0.1:{port}"


@pytest.mark.parametrize("kind", ["control", "image"])
def test_connection_when_nobody_listens_names_the_server_and_the_option(kind: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(ConnectionLostError, match=f"no {kind} server at .*--{kind}-port"):
        open_connection("127.0.0.1", port, 5.0, server_kind=kind)


FIRST, SECOND = (OdometryReading("Odometry", x, 2.0, 0.5) for x in (1.0, 2.0))
STATUS = VehicleStatus(1.0, 1200)


@contextmanager
def connect_to_script(script: Script) -> Iterator[ControlConnection]:
    """Yield a connection whose clock advances by a tenth of a second per reading."""
    ticks = iter(range(1000))
    with serve_script(script) as port:
        plain = open_connection("127.0.0.1", port, 5.0, server_kind="control")
        connection = ControlConnection(plain, timeout_s=5.0, clock=lambda: 0.1 * next(ticks))
        with plain:
            yield connection
            connection.close()


def send_reports(connection: socket.socket) -> None:
    ScriptedControlPeer(connection).send(FIRST, SECOND, STATUS, FIRST)
    wait_for_close(connection)


def test_reports_when_waited_for_come_in_order_and_the_newest_are_kept() -> None:
    with connect_to_script(send_reports) as connection:
        assert connection.get_latest(OdometryReading) is None
        found = connection.wait_until(lambda report: report == STATUS, "a status")
        assert found[1:] == [FIRST, SECOND, STATUS]  # behind the greeting
        assert connection.wait_for_report(OdometryReading, "odometry") == FIRST
        assert connection.get_latest(VehicleStatus) == STATUS
        assert STATUS in connection.latest_reports


def test_reports_when_only_some_are_accepted_pass_over_the_others() -> None:
    with connect_to_script(send_reports) as connection:
        assert (
            connection.wait_for_report(OdometryReading, "x", lambda report: report.x_m == 2.0)
            == SECOND
        )


def test_wait_when_others_come_for_ever_ends_in_time_and_names_the_missing_report() -> None:
    with connect_to_script(send_reports) as connection:
        with pytest.raises(
            ReplyTimeoutError, match="is connected but did not send the start poses"
        ):
            connection.wait_for_report(StartPoses, "the start poses", timeout_s=0.3)


def test_command_when_sent_arrives() -> None:
    def script(connection: socket.socket) -> None:
        assert ScriptedControlPeer(connection).receive_command() == GetStartPoses()

    with connect_to_script(script) as connection:
        connection.send(GetStartPoses())
        with pytest.raises(ConnectionLostError, match="connect and spawn again"):
            connection.wait_for_report(StartPoses, "the start poses")


def test_connection_when_made_does_not_delay_short_commands() -> None:
    with serve_script(wait_for_close) as port:
        with open_connection("127.0.0.1", port, 5.0, server_kind="control") as plain:
            assert plain.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) != 0
