"""Client of the image port: request, receive, decode, over TCP.

Blocking, for one thread; a thin shell around `ImageFrameReader`, which has no socket. A server in
legacy mode (UPIS -l, UDK LegacyMode=true) sends one unsolicited frame after accepting: take it with
`receive_frame` before the first `get_frame` or `iter_frames`, or every frame will be the reply to
the previous request.
"""

from __future__ import annotations

import logging
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator

import cv2
import numpy as np

from catoptra_client.control_connection import open_connection, peer_address
from catoptra_client.frame import Frame, Pixels, rgb_from_image_bytes
from catoptra_protocol.errors import ConnectionLostError
from catoptra_protocol.usarsim.image_port import (
    EncodedFrame,
    ImageFrameReader,
    ImageType,
    encode_full_frame_request,
    parse_raw_size,
)

_LOG = logging.getLogger(__name__)
# About a raw frame of 640 x 640 px.
_READ_BYTES = 1024 * 1024
_RAW_HEADER_BYTES = 4


class ImageClient:
    """One connection to the image port, from `connect` to `close`; also a context manager.

    Waiting calls raise ConnectionLostError if the server disconnects or sends nothing for
    `timeout_s`, and RemoteProtocolError for a malformed frame.
    """

    def __init__(
        self,
        connection: socket.socket,
        *,
        timeout_s: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take over a connected socket.

        Args:
            connection: Connected socket; closed by `close`.
            timeout_s: Timeout of each frame.
            clock: Clock of `Frame.received_s`, in seconds.
        """
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
    def connect(
        cls, host: str = "127.0.0.1", port: int = 5003, timeout_s: float = 5.0
    ) -> ImageClient:
        """Connect, without a request yet.

        Raises:
            ConnectionLostError: No server at this address.
        """
        return cls(open_connection(host, port, timeout_s, server_kind="image"), timeout_s=timeout_s)

    def close(self) -> None:
        """End the connection."""
        self._socket.close()

    def __enter__(self) -> ImageClient:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def request_frame(self) -> None:
        """Request one frame; each request gets one, in order."""
        try:
            self._socket.sendall(encode_full_frame_request())
        except OSError as error:
            raise self._connection_lost_error(str(error)) from error
        self._num_pending_requests += 1

    def receive_frame(self) -> Frame:
        """Next frame of the server."""
        while not self._unread:
            self._unread.extend(self._read_frames())
        encoded = self._unread.popleft()
        _LOG.debug("from %s: %s", self._peer, encoded)
        rgb = rgb_from_encoded_frame(encoded)
        frame = Frame(rgb, self._sequence, self._received_s, encoded.image_type)
        self._sequence += 1
        # At least 0: the unsolicited frame of legacy mode has no request.
        self._num_pending_requests = max(self._num_pending_requests - 1, 0)
        return frame

    def get_frame(self) -> Frame:
        """Request a frame and wait; frames of earlier requests are skipped."""
        self.request_frame()
        # Left over from an iteration that ended early.
        while self._num_pending_requests > 1:
            self.receive_frame()
        return self.receive_frame()

    def iter_frames(self) -> Iterator[Frame]:
        """Iterate over frames for ever, one request ahead, so that both sides work in parallel.

        A frame is therefore as old as the processing time of the one before; with a lockstep server
        use `get_frame`, which requests after the step.
        """
        # Two requests at the start: one frame is rendered while the one before is processed.
        if not self._num_pending_requests:
            self.request_frame()
        while True:
            self.request_frame()
            yield self.receive_frame()

    def _read_frames(self) -> list[EncodedFrame]:
        try:
            data = self._socket.recv(_READ_BYTES)
        # A server that stopped gives no sign over TCP, so a timeout counts as a lost connection.
        except TimeoutError as error:
            raise ConnectionLostError(
                f"{self._peer} is connected but sent no frame: is this the image port, was a frame "
                "requested, and does the server have a robot with a camera?"
            ) from error
        except OSError as error:
            raise self._connection_lost_error(str(error)) from error
        if not data:
            raise self._connection_lost_error("it closed the connection")
        # Before decoding, which takes milliseconds.
        self._received_s = self._clock()
        return self._reader.receive(data)

    def _connection_lost_error(self, reason: str) -> ConnectionLostError:
        return ConnectionLostError(
            f"lost the image server at {self._peer}: {reason}. See the log of the server; "
            "connect again"
        )


def rgb_from_encoded_frame(frame: EncodedFrame) -> Pixels:
    """Decode the RGB image of a frame: (h, w, 3) uint8, read-only; (0, 0, 3) for an empty payload.

    Raises:
        RemoteProtocolError: The payload is no image, or a larger one than the limits allow.
    """
    if not frame.payload:
        rgb: Pixels = np.zeros((0, 0, 3), np.uint8)
    elif frame.image_type is ImageType.RAW:
        rgb = _rgb_from_raw(frame.payload)
    else:
        rgb = rgb_from_image_bytes(frame.payload)
    # `Frame` promises a read-only array: several users may hold the same frame.
    rgb.setflags(write=False)
    return rgb


def _rgb_from_raw(payload: bytes) -> Pixels:
    width, height, pitch = parse_raw_size(payload)
    rows = np.frombuffer(payload, np.uint8, offset=_RAW_HEADER_BYTES).reshape(height, pitch)
    bgr = rows[:, : 3 * width].reshape(height, width, 3)
    # cvtColor takes a tenth of the time of a reversed copy, but rejects an image without pixels.
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8) if bgr.size else bgr.copy()


__all__ = ["Frame", "ImageClient", "Pixels", "rgb_from_encoded_frame"]
