"""The errors of Catoptra, one tree for all three distributions.

CatoptraError
├── ConfigError              a configuration file is wrong: file, line, key, value, expectation
├── DomainError              a formula was asked outside its domain; carries the mask
├── ProtocolError
│   ├── LocalProtocolError   our side tried to send what the protocol forbids
│   └── RemoteProtocolError  the other side sent what the protocol forbids
├── ConnectionLostError      the other side went away
├── DeadlineExceededError          the other side is there, but what was asked for did not come in time
└── RendererUnavailableError a renderer cannot run on this machine; says what to install
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


class CatoptraError(Exception):
    """Base of every error that Catoptra raises on purpose."""


@dataclass(frozen=True, slots=True)
class SourceLocation:
    """The place in a file that an error speaks of. Lines count from 1; 0 = the whole file."""

    file: str
    line: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}" if self.line else self.file


class ConfigError(CatoptraError):
    """Say which file, line, key and value is wrong, and what was expected instead."""

    def __init__(self, location: SourceLocation, *, key: str, value: str, expected: str) -> None:
        super().__init__(f"{location}: {key}={value!r}: expected {expected}")
        self.location = location
        self.key = key
        self.value = value
        self.expected = expected


class DomainError(CatoptraError):
    """Say that a formula was asked outside its domain; `valid` tells which elements were inside."""

    def __init__(self, message: str, valid_mask: Any = None) -> None:  # a bool array; no numpy here
        super().__init__(message)
        self.valid_mask = valid_mask


class ProtocolError(CatoptraError):
    """Base of the two protocol errors."""


class LocalProtocolError(ProtocolError):
    """Our side tried to send what the protocol forbids: a bug in the caller."""


class RemoteProtocolError(ProtocolError):
    """The other side sent what the protocol forbids."""


class ConnectionLostError(CatoptraError):
    """The other side closed the connection or did not answer in time."""


class DeadlineExceededError(CatoptraError):
    """The server lives and says so, but did not send in time what was asked for."""


class RendererUnavailableError(CatoptraError):
    """A renderer cannot run on this machine; the message names what is missing and the remedy."""
