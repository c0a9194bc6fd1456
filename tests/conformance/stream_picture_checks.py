"""Checks of a standing robot's pictures: one picture in all encodings and on both ports."""

from __future__ import annotations

import math

from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.stream.requests import ImageEncoding
from conformance.check import (
    Check,
    CheckFailed,
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


def check_bound(server: ServerUnderTest) -> None:
    """A frame of a hyperbolic camera has a bound, the sum of its parts as error_bounds."""
    with spawn_on_stream(server) as robot:
        frame = robot.get_frame()
    if not (
        isinstance(frame.camera, OmniCamera) and isinstance(frame.camera.mirror, HyperbolicMirror)
    ):
        raise CheckSkipped("only cameras with a hyperbolic mirror have a bound in any case")
    bound, parts = frame.error_bound_px, frame.error_bounds or {}
    if bound is None or not (math.isfinite(bound) and bound >= 0.0):
        raise CheckFailed(f"error_bound_px is {bound}: expected a finite number of at least 0")
    total = parts.get("max_px", math.nan) + parts.get("edge_px", math.nan)
    for name, value in (
        ("outline_px", parts.get("outline_px", math.nan)),
        ("max_px + edge_px", total),
    ):
        if not math.isclose(bound, value, rel_tol=_RELATIVE_TOLERANCE):
            raise CheckFailed(f"error_bound_px is {bound:g}, {name} of error_bounds {value:g}")


PICTURE_CHECKS: tuple[Check, ...] = (
    check_from_function("stream_encodings", "stream", check_encodings),
    check_from_function("stream_image_port", "stream", check_image_port),
    check_from_function("stream_bound", "stream", check_bound),
)
