"""The exceptions of Catoptra, one tree for all distributions.

CatoptraError
├── ConfigError              a configuration file is wrong: file, line, key, value, expectation
├── DomainError              an argument outside the domain of a formula; carries the mask
├── ProtocolError
│   ├── LocalProtocolError   this side tried to send a message that the protocol forbids
│   └── RemoteProtocolError  the peer sent a message that the protocol forbids
│       └── InvalidRequestError  a request of the stream with a readable id; carries the id
├── ConnectionLostError      the peer disconnected or sends nothing
├── DeadlineExceededError    the peer is connected, but its reply did not arrive in time
└── RendererUnavailableError a renderer cannot run on this machine; names the missing part
"""

from __future__ import annotations

from typing import Any

from catoptra_protocol.slotted_dataclass import dataclass


class CatoptraError(Exception):
    """Base class of every exception that Catoptra raises on purpose."""


@dataclass(frozen=True, slots=True)
class SourceLocation:
    """Location of a fault in a file, printed as file:line."""

    file: str
    """Path as the user gave it."""
    line: int = 0
    """Number of the line, from 1; 0 = the whole file."""

    def __str__(self) -> str:
        return f"{self.file}:{self.line}" if self.line else self.file


class ConfigError(CatoptraError):
    """A wrong value in a configuration file: its location, key, value and the expectation."""

    def __init__(self, location: SourceLocation, *, key: str, value: str, expected: str) -> None:
        super().__init__(f"{location}: {key}={_quote(value)}: expected {expected}")
        self.location = location
        self.key = key
        self.value = value
        self.expected = expected


# A line of a real file; longer values, such as a mistaken binary file's, would hide the message.
_MAX_QUOTED_CHARS = 200


def _quote(value: str) -> str:
    """Value in quotes, shortened to what fits into a message."""
    if len(value) <= _MAX_QUOTED_CHARS:
        return repr(value)
    return f"{value[:_MAX_QUOTED_CHARS]!r}... ({len(value)} characters)"


class DomainError(CatoptraError):
    """An argument outside the domain of a formula.

    `valid_mask` is a boolean array of the elements inside the domain; None for scalars.
    """

    # Any instead of an array type: this module must import without NumPy.
    def __init__(self, message: str, valid_mask: Any = None) -> None:
        super().__init__(message)
        self.valid_mask = valid_mask


class ProtocolError(CatoptraError):
    """Base class of the two protocol errors."""


class LocalProtocolError(ProtocolError):
    """This side tried to send a message that the protocol forbids: a bug in the caller."""


class RemoteProtocolError(ProtocolError):
    """The peer sent a message that the protocol forbids."""


class InvalidRequestError(RemoteProtocolError):
    """A request of the stream whose id is readable and whose kind or another field is wrong."""

    def __init__(self, message: str, request_id: int) -> None:
        super().__init__(message)
        self.request_id = request_id


class ConnectionLostError(CatoptraError):
    """The peer closed the connection, or sends nothing at all."""


class DeadlineExceededError(CatoptraError):
    """The server sends heartbeats, but its reply did not arrive within the timeout."""


class RendererUnavailableError(CatoptraError):
    """A renderer cannot run on this machine; the message names the missing part and the remedy."""
