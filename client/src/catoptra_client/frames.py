"""Frames from an address, over either transport."""

from __future__ import annotations

from dataclasses import replace
from urllib.parse import SplitResult, parse_qsl, urlsplit

from catoptra_client.frame import Frame, FrameSource
from catoptra_client.images import ImageStream
from catoptra_client.stream import StreamClient
from catoptra_client.stream_frames import StreamFrames, Watched
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.wire.stream_requests import Encoding

_KEYS = ("robot", "camera", "encoding")


def open_frames(
    address: str,
    timeout_s: float = 5.0,
    *,
    robot: str | None = None,
    camera: str | None = None,
    encoding: Encoding | None = None,
) -> FrameSource:
    """Return what brings frames from `tcp://host:port` (image server) or `zmq://host:port`.

    Without a port: 5003 and 5005. Over the stream a camera may be chosen, by keywords or in the
    address, `zmq://host:port?robot=A&camera=Rear&encoding=png`; keywords count more. Over TCP it is
    the server that chooses. Raises CatoptraError for an address that makes no sense.
    """
    parts = urlsplit(address)
    try:
        host, port = parts.hostname or "127.0.0.1", parts.port
    except ValueError as error:
        raise _wrong(address) from error
    said = {"robot": robot, "camera": camera, "encoding": encoding}
    chosen = {key: value for key, value in said.items() if value is not None}
    match parts.scheme:
        case "tcp":
            if parts.query or chosen:
                raise _tcp_shows_one(address)
            return ImageStream.connect(host, 5003 if port is None else port, timeout_s)
        case "zmq":
            watched = replace(_watched(parts, address), **chosen)  # type: ignore[arg-type] # by name
            client = StreamClient.connect(host, 5005 if port is None else port, timeout_s)
            return StreamFrames(client, watched)
        case _:
            raise _wrong(address)


def _watched(parts: SplitResult, address: str) -> Watched:
    """Return what the part of an address behind its ? chooses."""
    asked = dict(parse_qsl(parts.query, keep_blank_values=True))
    unknown = [key for key in asked if key not in _KEYS]
    encoding = asked.get("encoding", Encoding.JPEG.value)
    if unknown or encoding not in [known.value for known in Encoding]:
        raise _wrong(address)
    return Watched(asked.get("robot", ""), asked.get("camera", ""), Encoding(encoding))


def _tcp_shows_one(address: str) -> CatoptraError:
    return CatoptraError(
        f"address {address!r}: the image port shows what the server's screen shows; choose a robot "
        "and camera over the stream, zmq://host:port?robot=A&camera=Rear"
    )


def _wrong(address: str) -> CatoptraError:
    return CatoptraError(
        f"address {address!r}: expected tcp://host:port of an image server or zmq://host:port of a "
        "stream, that one with ?robot=, &camera=, &encoding=raw, jpeg or png if need be"
    )


__all__ = ["Encoding", "Frame", "FrameSource", "open_frames"]
