"""Waiting on a control connection, against a scripted server."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from catoptra_client.control_connection import ControlConnection, SilentError
from catoptra_client.tcp import connected
from catoptra_protocol.errors import ConnectionLostError
from catoptra_protocol.wire.commands import GetStartPoses
from catoptra_protocol.wire.reports import OdometryReading, StartPoses, VehicleStatus
from client.scripted_server import ControlScript, Script, serving, wait_for_close

FIRST, SECOND = (OdometryReading("Odometry", x, 2.0, 0.5) for x in (1.0, 2.0))
STATUS = VehicleStatus(1.0, 1200)


@contextmanager
def connection_to(script: Script) -> Iterator[ControlConnection]:
    """Yield a connection whose clock goes on by a tenth of a second a look."""
    ticks = iter(range(1000))
    with serving(script) as port:
        plain = connected("127.0.0.1", port, 5.0, server="control")
        connection = ControlConnection(plain, timeout_s=5.0, clock=lambda: 0.1 * next(ticks))
        with plain:
            yield connection
            connection.close()


def telling(connection: socket.socket) -> None:
    ControlScript(connection).send(FIRST, SECOND, STATUS, FIRST)
    wait_for_close(connection)


def test_reports_when_waited_for_come_in_order_and_the_newest_are_kept() -> None:
    with connection_to(telling) as connection:
        assert connection.newest(OdometryReading) is None
        found = connection.wait_until(lambda report: report == STATUS, "a status")
        assert found[1:] == [FIRST, SECOND, STATUS]  # behind the greeting
        assert connection.wait(OdometryReading, "odometry") == FIRST
        assert connection.newest(VehicleStatus) == STATUS
        assert STATUS in connection.latest


def test_reports_when_only_some_are_accepted_pass_over_the_others() -> None:
    with connection_to(telling) as connection:
        assert connection.wait(OdometryReading, "x", lambda report: report.x_m == 2.0) == SECOND


def test_wait_when_others_come_for_ever_ends_in_time_and_names_what_lacks() -> None:
    with connection_to(telling) as connection:
        with pytest.raises(SilentError, match="is connected but did not send the start poses"):
            connection.wait(StartPoses, "the start poses", timeout_s=0.3)


def test_command_when_sent_arrives() -> None:
    def script(connection: socket.socket) -> None:
        assert ControlScript(connection).next_command() == GetStartPoses()

    with connection_to(script) as connection:
        connection.send(GetStartPoses())
        with pytest.raises(ConnectionLostError, match="connect and spawn again"):
            connection.wait(StartPoses, "the start poses")


def test_connection_when_made_does_not_delay_short_commands() -> None:
    with serving(wait_for_close) as port:
        with connected("127.0.0.1", port, 5.0, server="control") as plain:
            assert plain.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) != 0
