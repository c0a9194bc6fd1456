"""Frame sources by URL, over either transport."""

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
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.stream.requests import ImageEncoding

_QUERY_KEYS = ("robot", "camera", "encoding", "picture")


def open_frame_source(
    url: str,
    timeout_s: float = 5.0,
    *,
    robot: str | None = None,
    camera: str | None = None,
    encoding: ImageEncoding | None = None,
    picture: Picture | None = None,
) -> FrameSource:
    """Connect to `tcp://host:port` (image port) or `zmq://host:port` (stream).

    Args:
        url: Address; default ports 5003 and 5005. Over the stream a camera may be selected,
            `zmq://host:port?robot=A&camera=Rear&encoding=png&picture=flipped`.
        timeout_s: Timeout of the connection and of each frame.
        robot: Name of the robot, in place of that in the URL.
        camera: Name of the camera, in place of that in the URL.
        encoding: Encoding of images, in place of that in the URL.
        picture: Hand of images of an omnidirectional camera, in place of that in the URL.

    Raises:
        CatoptraError: The URL is malformed, or selects a camera over TCP, where the server does.
        ConnectionLostError: No server at this address.
    """
    # An explicit port 0 is passed on, so that its error names the port that the user typed.
    parts = urlsplit(url)
    try:
        host, port = parts.hostname or "127.0.0.1", parts.port
    except ValueError as error:
        raise _url_error(url) from error
    keywords = {"robot": robot, "camera": camera, "encoding": encoding, "picture": picture}
    overrides = {key: value for key, value in keywords.items() if value is not None}
    match parts.scheme:
        case "tcp":
            if parts.query or overrides:
                raise _tcp_selection_error(url)
            return ImageClient.connect(host, 5003 if port is None else port, timeout_s)
        case "zmq":
            selection = replace(_parse_selection(parts, url), **overrides)  # type: ignore[arg-type] # by name
            client = StreamClient.connect(host, 5005 if port is None else port, timeout_s)
            return StreamFrameSource(client, selection)
        case _:
            raise _url_error(url)


def _parse_selection(parts: SplitResult, url: str) -> CameraSelection:
    """Camera selection in the query of a URL."""
    # Blank values are valid: an empty camera is the first one of a robot.
    query = dict(parse_qsl(parts.query, keep_blank_values=True))
    unknown = [key for key in query if key not in _QUERY_KEYS]
    encoding = query.get("encoding", ImageEncoding.JPEG.value)
    picture = query.get("picture", "")
    is_known = encoding in [known.value for known in ImageEncoding] and picture in ("", *Picture)
    if unknown or not is_known:
        raise _url_error(url)
    return CameraSelection(
        query.get("robot", ""), query.get("camera", ""), ImageEncoding(encoding), picture
    )


def _tcp_selection_error(url: str) -> CatoptraError:
    return CatoptraError(
        f"address {url!r}: the image port has one picture for all clients; select a robot and a "
        "camera over the stream, zmq://host:port?robot=A&camera=Rear"
    )


def _url_error(url: str) -> CatoptraError:
    return CatoptraError(
        f"address {url!r}: expected tcp://host:port of an image server or zmq://host:port of a "
        "stream, the latter optionally with ?robot=, &camera=, &encoding=raw, jpeg or png"
    )


__all__ = ["Frame", "FrameSource", "ImageEncoding", "open_frame_source"]
