"""Check of a standing robot's pictures: one picture in all encodings."""

from __future__ import annotations

from catoptra_protocol.stream.requests import ImageEncoding
from conformance.check import (
    Check,
    ServerUnderTest,
    check_from_function,
)
from conformance.image_checks import require_equal_pictures
from conformance.stream_session import spawn_on_stream


def check_encodings(server: ServerUnderTest) -> None:
    """The picture of a standing robot is the same as raw, as PNG and as JPEG."""
    with spawn_on_stream(server) as robot:
        pictures = {encoding: robot.get_frame(encoding).rgb for encoding in ImageEncoding}
    for encoding, rgb in pictures.items():
        require_equal_pictures(pictures[ImageEncoding.PNG], rgb, f"png and {encoding.value}")


PICTURE_CHECKS: tuple[Check, ...] = (
    check_from_function("stream_encodings", "stream", check_encodings),
)
