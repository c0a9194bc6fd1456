"""Sources of camera frames, over the image port (TCP) or the stream (ZeroMQ).

`frame_source` opens a source by its URL; `image_client` is a connection to the image port;
`stream` a connection to the ZeroMQ stream, for frames and for a robot. All return
`catoptra_client.frame.Frame`. Users import from here.
"""

from catoptra_client.frame_sources.frame_source import open_frame_source
from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.frame_sources.stream import (
    CameraSelection,
    LandmarkProjection,
    StreamClient,
    StreamFrameSource,
)
from catoptra_protocol.stream.requests import ImageEncoding

__all__ = [
    "CameraSelection",
    "ImageClient",
    "ImageEncoding",
    "LandmarkProjection",
    "StreamClient",
    "StreamFrameSource",
    "open_frame_source",
]
