"""Frames from the image server, over TCP: ask, receive, decode.

Blocking, for one thread; a thin shell around the sans-I/O `ImageFrameReader`. A server in legacy
mode (UPIS -l, UDK LegacyMode=true) sends one frame unasked after accept: take it with `receive`
before the first `frame` or `frames`, or every frame will be the answer to the request before.
"""

from __future__ import annotations

import logging
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from catoptra_client.frame import Frame, Pixels, rgb_from_image_bytes
from catoptra_client.tcp import open_connection, peer_address
from catoptra_protocol.errors import ConnectionLostError
from catoptra_protocol.usarsim.image_port import (
    EncodedFrame,
    ImageFrameReader,
    ImageType,
    encode_full_frame_request,
    parse_raw_size,
)

_LOG = logging.getLogger(__name__)
_READ_BYTES = 1024 * 1024
_RAW_HEADER_BYTES = 4


class ImageClient:
    """One connection to the image server, from `connect` to `close`; also a context manager.

    Waiting calls raise ConnectionLostError if the server goes away or stays silent for `timeout_s`,
    and RemoteProtocolError for a frame that cannot be.
    """

    def __init__(
        self,
        connection: socket.socket,
        *,
        timeout_s: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take over a connected socket. `clock` gives `Frame.received_s`."""
        self._socket = connection
        self._peer = peer_address(connection)
        self._clock = clock
        self._reader = ImageFrameReader()
        self._unread: deque[EncodedFrame] = deque()
        self._received_s = 0.0
        self._sequence = 0
        self._num_pending_requests = 0
        connection.settimeout(timeout_s)

    @classmethod
    def connect(cls, host: str = "127.0.0.1", port: int = 5003, timeout_s: float = 5.0) -> Self:
        """Return a stream on which nothing has been asked for yet."""
        return cls(open_connection(host, port, timeout_s, server_kind="image"), timeout_s=timeout_s)

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def request_frame(self) -> None:
        """Ask for one frame; each request is answered by one, in order."""
        try:
            self._socket.sendall(encode_full_frame_request())
        except OSError as error:
            raise self._connection_lost_error(str(error)) from error
        self._num_pending_requests += 1

    def receive_frame(self) -> Frame:
        """Return the next frame that the server sends."""
        while not self._unread:
            self._unread.extend(self._read_frames())
        wire_frame = self._unread.popleft()
        _LOG.debug("from %s: %s", self._peer, wire_frame)
        rgb = rgb_from_encoded_frame(wire_frame)
        frame = Frame(rgb, self._sequence, self._received_s, wire_frame.image_type)
        self._sequence += 1
        self._num_pending_requests = max(self._num_pending_requests - 1, 0)
        return frame

    def get_frame(self) -> Frame:
        """Ask for a frame and return it; frames still owed from before are passed over."""
        self.request_frame()
        while self._num_pending_requests > 1:
            self.receive_frame()
        return self.receive_frame()

    def iter_frames(self) -> Iterator[Frame]:
        """Iterate over frames for ever, one request ahead, so that server and client both work.

        A frame is therefore as old as the use that is made of the one before it; with a lockstep
        server take `frame`, which asks after the step.
        """
        if not self._num_pending_requests:
            self.request_frame()
        while True:
            self.request_frame()
            yield self.receive_frame()

    def _read_frames(self) -> list[EncodedFrame]:
        try:
            data = self._socket.recv(_READ_BYTES)
        except TimeoutError as error:
            raise ConnectionLostError(
                f"{self._peer} is connected but sent no frame: is this the image port, was a frame "
                "asked for, and does the server have a robot with a camera?"
            ) from error
        except OSError as error:
            raise self._connection_lost_error(str(error)) from error
        if not data:
            raise self._connection_lost_error("it closed the connection")
        self._received_s = self._clock()
        return self._reader.receive(data)

    def _connection_lost_error(self, reason: str) -> ConnectionLostError:
        return ConnectionLostError(
            f"lost the image server at {self._peer}: {reason}. Its log tells why; connect again"
        )


def rgb_from_encoded_frame(frame: EncodedFrame) -> Pixels:
    """Return the (h, w, 3) uint8 RGB picture of a frame, read-only; (0, 0, 3) if it is empty.

    Raises RemoteProtocolError if the payload is no picture, or a larger one than we accept.
    """
    if not frame.payload:
        rgb: Pixels = np.zeros((0, 0, 3), np.uint8)
    elif frame.image_type is ImageType.RAW:
        rgb = _rgb_from_raw(frame.payload)
    else:
        rgb = rgb_from_image_bytes(frame.payload)
    rgb.setflags(write=False)
    return rgb


def _rgb_from_raw(payload: bytes) -> Pixels:
    width, height, pitch = parse_raw_size(payload)
    rows = np.frombuffer(payload, np.uint8, offset=_RAW_HEADER_BYTES).reshape(height, pitch)
    bgr = rows[:, : 3 * width].reshape(height, width, 3)
    # cvtColor takes a tenth of the time of a reversed copy, but refuses a picture without pixels.
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8) if bgr.size else bgr.copy()


__all__ = ["Frame", "ImageClient", "Pixels", "rgb_from_encoded_frame"]
