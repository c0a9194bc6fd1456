"""Checks of a standing robot's pictures: one picture in all encodings and on both ports."""

from __future__ import annotations

from catoptra_protocol.stream.requests import ImageEncoding
from conformance.check import (
    Check,
    CheckSkipped,
    ServerUnderTest,
    check_from_function,
)
from conformance.image_checks import require_equal_pictures
from conformance.image_session import connect_images
from conformance.stream_session import spawn_on_stream

# The parts of a bound are stated as doubles.
_RELATIVE_TOLERANCE = 1e-6


def check_encodings(server: ServerUnderTest) -> None:
    """The picture of a standing robot is the same as raw, as PNG and as JPEG."""
    with spawn_on_stream(server) as robot:
        pictures = {encoding: robot.get_frame(encoding).rgb for encoding in ImageEncoding}
    for encoding, rgb in pictures.items():
        require_equal_pictures(pictures[ImageEncoding.PNG], rgb, f"png and {encoding.value}")


def check_image_port(server: ServerUnderTest) -> None:
    """The image-port picture on the stream is that of the image port."""
    if "image" not in server.addresses:
        raise CheckSkipped("no image port")
    with spawn_on_stream(server) as robot, connect_images(server) as images:
        for encoding in ImageEncoding:
            on_stream = robot.client.get_frame(encoding=encoding).rgb
            names = f"image port and {encoding.value} frame of the stream"
            require_equal_pictures(images.get_picture(), on_stream, names)


PICTURE_CHECKS: tuple[Check, ...] = (
    check_from_function("stream_encodings", "stream", check_encodings),
    check_from_function("stream_image_port", "stream", check_image_port),
)
