"""Client side of the ZeroMQ stream.

`zmq_socket` is the socket and the liveness of the server, `frame_decoding` makes frames of received
parts, `stream_client` has requests and replies on top of both, and `stream_frame_source` makes one
selected camera a `FrameSource`.
"""

from catoptra_client.frame_sources.stream.stream_client import LandmarkProjection, StreamClient
from catoptra_client.frame_sources.stream.stream_frame_source import (
    CameraSelection,
    StreamFrameSource,
)

__all__ = ["CameraSelection", "LandmarkProjection", "StreamClient", "StreamFrameSource"]
