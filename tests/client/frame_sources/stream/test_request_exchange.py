"""One request, one reply: other replies are skipped or rejected."""

from __future__ import annotations

import time

import pytest

from catoptra_client.frame_sources.stream.stream_client import RequestExchange
from catoptra_client.frame_sources.stream.zmq_socket import StreamSocket
from catoptra_protocol.errors import CatoptraError, RemoteProtocolError
from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error, Ok, Reply, SensorReports
from catoptra_protocol.stream.requests import Request, ResetRequest
from helpers.scripted_stream import serve_stream_script

REPORTS = SensorReports(7, ("SEN",))


def call_with_replies(*replies: Reply) -> SensorReports:
    """Result of a request with id 7 that has these replies."""

    def reply(request: Request) -> list[list[bytes]]:
        return [[bytes_from_message(one)] for one in replies]

    with serve_stream_script(reply) as port:
        socket = StreamSocket("127.0.0.1", port, clock=time.monotonic)
        exchange = RequestExchange(socket, timeout_s=5.0, clock=time.monotonic)
        try:
            return exchange.call(ResetRequest(7), SensorReports)
        finally:
            exchange.close()


def test_reply_when_it_follows_a_late_one_is_found_by_its_id() -> None:
    assert call_with_replies(Ok(6), REPORTS) == REPORTS


@pytest.mark.parametrize(
    ("reply", "error", "reason"),
    [
        (Error(7, "no robot"), CatoptraError, "rejected the request: no robot"),
        (Error(0, "no msgpack"), RemoteProtocolError, "cannot read the request: no msgpack"),
        (Ok(7), RemoteProtocolError, "replied with ok"),
    ],
)
def test_reply_when_it_is_no_result_raises_with_the_reason(
    reply: Reply, error: type[CatoptraError], reason: str
) -> None:
    with pytest.raises(error, match=reason):
        call_with_replies(reply)
