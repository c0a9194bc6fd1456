"""The socket of a stream client: liveness of the server, and no queue for a server that is down."""

from __future__ import annotations

import time

import pytest
import zmq

from catoptra_client.frame_sources.stream import zmq_socket
from catoptra_client.frame_sources.stream.zmq_socket import StreamSocket
from catoptra_protocol.errors import ConnectionLostError
from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.requests import GetStatusRequest, Request
from helpers.scripted_stream import HEARTBEAT, serve_stream_script

STATUS_REQUEST = bytes_from_message(GetStatusRequest(1))


def reply_with_heartbeat(request: Request) -> list[list[bytes]]:
    return [[HEARTBEAT]]


def send_repeatedly(socket: StreamSocket, deadline_s: float) -> None:
    """Send until an error: the first message may still go into a connection that is ending."""
    while True:
        socket.send(STATUS_REQUEST, deadline_s)


def test_reply_when_received_has_its_parts() -> None:
    with serve_stream_script(reply_with_heartbeat) as port:
        socket = StreamSocket("127.0.0.1", port)
        socket.send(STATUS_REQUEST, time.monotonic() + 5.0)
        assert socket.receive(time.monotonic() + 5.0) == [HEARTBEAT]
        assert socket.receive(time.monotonic()) is None
        socket.close()


def test_message_when_there_is_no_server_is_not_queued() -> None:
    with serve_stream_script(reply_with_heartbeat) as port:
        pass
    socket = StreamSocket("127.0.0.1", port)
    with pytest.raises(ConnectionLostError, match=f"no stream server at 127.0.0.1:{port}"):
        socket.send(STATUS_REQUEST, time.monotonic() + 0.05)
    received: list[Request] = []

    def record_request(request: Request) -> list[list[bytes]]:
        received.append(request)
        return [[HEARTBEAT]]

    with serve_stream_script(record_request, port=port):
        socket.send(bytes_from_message(GetStatusRequest(2)), time.monotonic() + 5.0)
        assert socket.receive(time.monotonic() + 5.0) == [HEARTBEAT]
    assert received == [GetStatusRequest(2)]
    socket.close()


def test_server_when_it_sends_heartbeats_is_not_lost() -> None:
    with serve_stream_script(reply_with_heartbeat, sends_heartbeats=True) as port:
        socket = StreamSocket("127.0.0.1", port)
        socket.send(STATUS_REQUEST, time.monotonic() + 5.0)
        socket.begin_wait()
        socket.check_alive()
        socket.close()


def test_server_when_silent_is_lost_long_before_the_deadline(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(zmq_socket, "_SILENT_SERVER_TIMEOUT_S", 0.2)
    with serve_stream_script(lambda request: []) as port:
        socket = StreamSocket("127.0.0.1", port)
        deadline_s = time.monotonic() + 60.0
        socket.send(STATUS_REQUEST, deadline_s)
        socket.begin_wait()
        with pytest.raises(ConnectionLostError, match="no heartbeat"):
            socket.receive(deadline_s)
        assert time.monotonic() < deadline_s - 30.0
        socket.close()


def test_server_when_silent_for_less_than_its_timeout_is_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(zmq_socket, "_SERVER_TIMEOUT_S", 0.3)
    with serve_stream_script(lambda request: []) as port:
        socket = StreamSocket("127.0.0.1", port)
        socket.send(STATUS_REQUEST, time.monotonic() + 5.0)
        socket.begin_wait()
        # Longer than without a connection: the server compiles, or the machine is busy.
        assert socket.receive(time.monotonic() + 0.6) is None
        socket.close()


def test_server_when_gone_is_lost_while_a_reply_is_waited_for() -> None:
    with serve_stream_script(lambda request: []) as port:
        socket = StreamSocket("127.0.0.1", port)
        socket.send(STATUS_REQUEST, time.monotonic() + 5.0)
        socket.begin_wait()
    with pytest.raises(ConnectionLostError, match="no heartbeat"):
        socket.receive(time.monotonic() + 60.0)
    socket.close()


def test_server_when_gone_is_lost_long_before_the_deadline_of_a_message(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with serve_stream_script(reply_with_heartbeat) as port:
        socket = StreamSocket("127.0.0.1", port)
        socket.send(STATUS_REQUEST, time.monotonic() + 5.0)
        assert socket.receive(time.monotonic() + 5.0) == [HEARTBEAT]
    monkeypatch.setattr(zmq_socket, "_SERVER_TIMEOUT_S", 0.2)
    deadline_s = time.monotonic() + 60.0
    socket.begin_wait()
    with pytest.raises(ConnectionLostError, match="no stream server"):
        send_repeatedly(socket, deadline_s)
    assert time.monotonic() < deadline_s - 30.0
    socket.close()


def test_message_when_its_connection_ends_at_that_moment_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with serve_stream_script(reply_with_heartbeat) as port:
        pass
    socket, answers = StreamSocket("127.0.0.1", port), iter([True, False])
    socket._socket.set(zmq.SNDTIMEO, 200)  # a send that waits ends with another error
    monkeypatch.setattr(socket, "_poll", lambda *_: next(answers))
    with pytest.raises(ConnectionLostError, match="no stream server"):
        socket.send(STATUS_REQUEST, time.monotonic() + 5.0)
    socket.close()
