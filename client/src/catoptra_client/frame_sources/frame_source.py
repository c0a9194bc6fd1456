"""Frames from an address, over either transport."""

from __future__ import annotations

from dataclasses import replace
from urllib.parse import SplitResult, parse_qsl, urlsplit

from catoptra_client.frame import Frame, FrameSource
from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.frame_sources.stream.stream_frame_source import (
    CameraSelection,
    StreamFrameSource,
)
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.stream.requests import ImageEncoding

_QUERY_KEYS = ("robot", "camera", "encoding")


def open_frame_source(
    url: str,
    timeout_s: float = 5.0,
    *,
    robot: str | None = None,
    camera: str | None = None,
    encoding: ImageEncoding | None = None,
) -> FrameSource:
    """Return what brings frames from `tcp://host:port` (image server) or `zmq://host:port`.

    Without a port: 5003 and 5005. Over the stream a camera may be chosen, by keywords or in the
    address, `zmq://host:port?robot=A&camera=Rear&encoding=png`; keywords count more. Over TCP it is
    the server that chooses. Raises CatoptraError for an address that makes no sense.
    """
    parts = urlsplit(url)
    try:
        host, port = parts.hostname or "127.0.0.1", parts.port
    except ValueError as error:
        raise _url_error(url) from error
    said = {"robot": robot, "camera": camera, "encoding": encoding}
    chosen = {key: value for key, value in said.items() if value is not None}
    match parts.scheme:
        case "tcp":
            if parts.query or chosen:
                raise _tcp_selection_error(url)
            return ImageClient.connect(host, 5003 if port is None else port, timeout_s)
        case "zmq":
            watched = replace(_parse_selection(parts, url), **chosen)  # type: ignore[arg-type] # by name
            client = StreamClient.connect(host, 5005 if port is None else port, timeout_s)
            return StreamFrameSource(client, watched)
        case _:
            raise _url_error(url)


def _parse_selection(parts: SplitResult, url: str) -> CameraSelection:
    """Return what the part of an address behind its ? chooses."""
    asked = dict(parse_qsl(parts.query, keep_blank_values=True))
    unknown = [key for key in asked if key not in _QUERY_KEYS]
    encoding = asked.get("encoding", ImageEncoding.JPEG.value)
    if unknown or encoding not in [known.value for known in ImageEncoding]:
        raise _url_error(url)
    return CameraSelection(asked.get("robot", ""), asked.get("camera", ""), ImageEncoding(encoding))


def _tcp_selection_error(url: str) -> CatoptraError:
    return CatoptraError(
        f"address {url!r}: the image port shows what the server's screen shows; choose a robot "
        "and camera over the stream, zmq://host:port?robot=A&camera=Rear"
    )


def _url_error(url: str) -> CatoptraError:
    return CatoptraError(
        f"address {url!r}: expected tcp://host:port of an image server or zmq://host:port of a "
        "stream, that one with ?robot=, &camera=, &encoding=raw, jpeg or png if need be"
    )


__all__ = ["Frame", "FrameSource", "ImageEncoding", "open_frame_source"]
