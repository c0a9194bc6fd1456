"""A deliberate fault between the suite and a real server, which the suite must notice."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

# Bytes of one message in, bytes that are passed on out; empty drops the message.
MutateBytes = Callable[[bytes], bytes]


def pass_through(data: bytes) -> bytes:
    """Message as it is."""
    return data


@dataclass(frozen=True, slots=True)
class ConnectionMutation:
    """Mutation of one TCP connection; its functions may hold the connection's state."""

    mutate_request: MutateBytes = pass_through
    """Of each message to the server: a line of the control port, a chunk of the image port."""
    mutate_reply: MutateBytes = pass_through
    """Of each message to the client: a line with its end, or a frame with its header."""
    split_replies_before: bytes = b""
    """Each message to the client is sent in two segments, the second one begins with these bytes;
    empty: in one.
    """


@dataclass(frozen=True, slots=True)
class Mutation:
    """A row of the table of mutations of a TCP port."""

    name: str
    port: str
    connect: Callable[[], ConnectionMutation]
    """Mutation of a new connection."""
    noticed_by: tuple[str, ...] = ()
    """Conversations and checks that fail."""
