"""The proxy of mutations against a server of one connection in a thread."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from conformance.conversation_file import Address
from conformance.mutation import ConnectionMutation
from conformance.mutation_proxy import (
    run_mutation_proxy,
    split_commands,
    split_frames,
    split_lines,
)
from helpers.legacy_sockets import receive, receive_exactly, reset_connection

TIMEOUT_S = 20.0
FRAME = b"\x03\0\0\0\x02ab"


@contextmanager
def serve_pieces(*pieces: bytes) -> Iterator[tuple[Address, list[bytes]]]:
    """A server that reads from one connection once, sends pieces and closes it."""
    received: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            connection, _ = listener.accept()
            with connection:
                received.append(connection.recv(4096))
                for piece in pieces:
                    connection.sendall(piece)

        thread = threading.Thread(target=serve)
        thread.start()
        yield listener.getsockname(), received
        thread.join()


def shout(line: bytes) -> bytes:
    """Upper case, a change that a test sees."""
    return line.upper()


def test_messages_when_split_are_whole_and_the_rest_stays() -> None:
    assert split_lines(b"a\r\nb\nc\r") == ([b"a\r\n", b"b\n"], b"c\r")
    assert split_commands(b"a\r\nb\n\rc\rd") == ([b"a\r\n", b"b\n\r", b"c\r"], b"d")
    # A text without an end, in linear time: a quadratic pattern takes minutes.
    assert split_commands(b"a\n" + bytes(400_000)) == ([b"a\n"], bytes(400_000))
    assert split_frames(FRAME + FRAME[:4]) == ([FRAME], FRAME[:4])
    assert split_frames(FRAME[:6]) == ([], FRAME[:6])


def test_proxy_when_lines_pass_mutates_each_way_by_whole_lines() -> None:
    with (
        serve_pieces(b"one\r", b"\ntwo\r\nthr") as (server, received),
        run_mutation_proxy("control", server, lambda: ConnectionMutation(shout, shout)) as address,
        socket.create_connection(address, timeout=TIMEOUT_S) as client,
    ):
        client.sendall(b"first\r\nsecond\r\n")
        assert receive_exactly(client, 10) == b"ONE\r\nTWO\r\n"
        with pytest.raises(ConnectionError):
            receive(client, 1)
    assert received[0].startswith(b"FIRST\r\n")


def test_proxy_when_a_message_is_dropped_passes_on_the_next() -> None:
    def drop_comments(line: bytes) -> bytes:
        return b"" if line.startswith(b"#") else line

    mutation = ConnectionMutation(mutate_reply=drop_comments)
    with (
        serve_pieces(b"#1\r\n2\r\n") as (server, _),
        run_mutation_proxy("control", server, lambda: mutation) as address,
        socket.create_connection(address, timeout=TIMEOUT_S) as client,
    ):
        client.sendall(b"x\n")
        assert receive_exactly(client, 3) == b"2\r\n"


def test_proxy_when_the_client_resets_resets_the_server() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = listener.getsockname()
        with run_mutation_proxy("image", address, ConnectionMutation) as proxy:
            client = socket.create_connection(proxy, timeout=TIMEOUT_S)
            connection, _ = listener.accept()
            connection.settimeout(TIMEOUT_S)
            reset_connection(client)
            with connection, pytest.raises(ConnectionResetError):
                connection.recv(1)


def test_proxy_when_the_server_is_gone_closes_the_connection() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        gone = listener.getsockname()
    with (
        run_mutation_proxy("image", gone, ConnectionMutation) as address,
        socket.create_connection(address, timeout=TIMEOUT_S) as client,
        pytest.raises(ConnectionError),
    ):
        receive(client, 1)
