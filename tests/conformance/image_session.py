"""One connection to an image port, for the checks of this port: encoded frames and pictures.

Nothing here assumes our own server.
"""

from __future__ import annotations

import io
import socket
import struct
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from PIL import Image

from catoptra_client.frame_sources.image_client import rgb_from_encoded_frame
from catoptra_protocol.usarsim.image_port import EncodedFrame, ImageFrameReader, ImageType
from conformance.check import CheckFailed, ServerUnderTest

Pixels = npt.NDArray[np.uint8]

# Ten times a slow server's frame, on a busy machine.
FRAME_TIMEOUT_S = 10.0
_READ_BYTES = 256 * 1024
_JPEG_END = b"\xff\xd9"
_REGION = struct.Struct(">c4I")


@dataclass(slots=True)
class ImageSession:
    """An open connection."""

    connection: socket.socket
    _reader: ImageFrameReader = field(default_factory=ImageFrameReader)
    _frames: deque[EncodedFrame] = field(default_factory=deque)

    def get_picture(self) -> Pixels:
        """Picture of a new full frame."""
        self.connection.sendall(b"OK")
        return decode_completely(self.receive())

    def get_region(self, x: int, y: int, width: int, height: int) -> Pixels:
        """Picture of a region of a new frame."""
        self.connection.sendall(_REGION.pack(b"U", x, y, width, height))
        return decode_completely(self.receive())

    def receive(self) -> EncodedFrame:
        """Next frame.

        Raises:
            CheckFailed: The server closed the connection, or sent nothing in time.
        """
        deadline_s = time.monotonic() + FRAME_TIMEOUT_S
        while not self._frames:
            self.connection.settimeout(max(deadline_s - time.monotonic(), 1e-3))
            try:
                data = self.connection.recv(_READ_BYTES)
            except TimeoutError:
                raise CheckFailed(f"no frame within {FRAME_TIMEOUT_S:g} s of a request") from None
            if not data:
                raise CheckFailed("the server closed the connection instead of sending a frame")
            self._frames.extend(self._reader.receive(data))
        return self._frames.popleft()


@contextmanager
def connect_images(server: ServerUnderTest) -> Iterator[ImageSession]:
    """Connect to the image port for the length of a block; the unsolicited frame is taken."""
    address = server.addresses["image"]
    with socket.create_connection(address, timeout=FRAME_TIMEOUT_S) as connection:
        session = ImageSession(connection)
        if server.legacy_images:
            session.receive()
        yield session


def decode_completely(frame: EncodedFrame) -> Pixels:
    """Picture of a frame whose encoding has no gap.

    Raises:
        CheckFailed: A JPEG without its end, or with data that its decoder complains about.
    """
    if frame.image_type is not ImageType.RAW:
        require_complete_jpeg(frame.payload)
    return rgb_from_encoded_frame(frame)


def require_complete_jpeg(data: bytes) -> None:
    """Fail where a JPEG stream is cut off or damaged; most decoders fill the rest with grey."""
    # Some encoders fill up with zeros.
    end = data.rstrip(b"\0")[-2:]
    if end != _JPEG_END:
        raise CheckFailed(
            f"a JPEG of {len(data)} bytes that ends with {end.hex(' ')}: expected the marker ff d9"
        )
    try:
        with Image.open(io.BytesIO(data)) as image:
            image.load()
    except (OSError, SyntaxError) as error:
        raise CheckFailed(f"a JPEG of {len(data)} bytes that is damaged: {error}") from error
