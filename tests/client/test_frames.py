"""Addresses of both transports. What they bring is compared in end_to_end/test_stream.py."""

from __future__ import annotations

import pytest

from catoptra_client.frames import open_frames
from catoptra_client.stream import StreamClient
from catoptra_protocol.errors import CatoptraError, ConnectionLostError
from client.test_stream import script
from helpers.scripted_stream import scripted_stream


@pytest.mark.parametrize("address", ["", "127.0.0.1:5003", "http://a:1", "zmq://a:seven"])
def test_address_when_wrong_says_what_is_expected(address: str) -> None:
    with pytest.raises(CatoptraError, match="expected tcp://host:port"):
        open_frames(address)


@pytest.mark.parametrize("scheme", ["tcp", "zmq"])
def test_address_when_nobody_listens_names_it(scheme: str) -> None:
    with pytest.raises(ConnectionLostError, match=r"127\.0\.0\.1:1"):
        open_frames(f"{scheme}://127.0.0.1:1", timeout_s=0.1)


def test_address_when_of_a_stream_opens_one() -> None:
    with scripted_stream(script) as port, open_frames(f"zmq://127.0.0.1:{port}") as source:
        assert isinstance(source, StreamClient)
