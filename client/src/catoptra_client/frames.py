"""Frames from an address, over either transport."""

from __future__ import annotations

from urllib.parse import urlsplit

from catoptra_client.frame import Frame, FrameSource
from catoptra_client.images import ImageStream
from catoptra_client.stream import StreamClient
from catoptra_protocol.errors import CatoptraError


def open_frames(address: str, timeout_s: float = 5.0) -> FrameSource:
    """Return what brings frames from `tcp://host:port` (image server) or `zmq://host:port`.

    Without a port: 5003 and 5005. The two differ in what a `Frame` tells, not in its picture.
    """
    parts = urlsplit(address)
    try:
        host, port = parts.hostname or "127.0.0.1", parts.port
    except ValueError as error:
        raise _wrong(address) from error
    match parts.scheme:
        case "tcp":
            return ImageStream.connect(host, 5003 if port is None else port, timeout_s)
        case "zmq":
            return StreamClient.connect(host, 5005 if port is None else port, timeout_s)
        case _:
            raise _wrong(address)


def _wrong(address: str) -> CatoptraError:
    return CatoptraError(
        f"address {address!r}: expected tcp://host:port of an image server or zmq://host:port of a "
        "stream"
    )


__all__ = ["Frame", "FrameSource", "open_frames"]
