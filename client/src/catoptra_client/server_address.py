"""Host and ports of a server, as one value to pass around."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ServerAddress:
    """Host and ports at which a server listens."""

    host: str
    control_port: int
    image_port: int
    stream_port: int | None = None
    """Port of the ZeroMQ stream; None where the caller uses TCP alone."""
