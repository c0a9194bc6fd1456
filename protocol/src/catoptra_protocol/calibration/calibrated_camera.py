"""A camera from a calibration's numbers (projection, matrix, image size), and back; and the mark.

All formats describe right-handed cameras, so a file says nothing of the hand of the pictures that
it was made from, and a mirrored world fits as well. Catoptra's own mark, a comment or a field, says
which pictures a file is of. Files of other programs have no mark.

A file of the other hand than the requested pictures is an error, not a mirror image.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from catoptra_protocol.calibration.files import Fields, file_error
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import (
    DistortedProjection,
    ImagePlane,
    decentred_fold_rad,
)
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import (
    WITHIN_LIMIT,
    Picture,
    RadialProjection,
    largest_angle_rad,
)
from catoptra_protocol.slotted_dataclass import dataclass

_FIELD = "catoptra_picture"
_MARK = re.compile(rf'"?{_FIELD}"?\s*[:=]\s*"?(\w+)')


def mark_picture(text: str, picture: Picture) -> str:
    """Text of a file with the mark: a field of a JSON object, a comment of others."""
    if text.startswith("{"):
        # The last field: Basalt's reader takes the first one, whatever its name.
        return f'{text.rstrip()[:-1].rstrip()},\n  "{_FIELD}": "{picture.value}"\n}}\n'
    comment = f"# {_FIELD}: {picture.value}\n"
    if text.startswith("%YAML"):
        # OpenCV wants the head as the first bytes, and no comment before the document.
        head, separator, body = text.partition("---\n")
        return head + separator + comment + body
    return comment + text


def read_picture_mark(text: str, file: str) -> Picture | None:
    """Hand of the pictures that a file describes; None for files without a mark.

    Raises:
        ConfigError: The mark names no hand.
    """
    found = _MARK.search(text)
    if found is None:
        return None
    try:
        return Picture(found[1])
    except ValueError as error:
        names = " or ".join(picture.value for picture in Picture)
        raise file_error(file, _FIELD, names, value=found[1]) from error


@dataclass(frozen=True, slots=True)
class Matrix:
    """Camera matrix in pixels whose first centre is 0, as OpenCV has it."""

    fx: float
    fy: float
    cx: float
    cy: float
    skew: float = 0.0


def make_camera(
    fields: Fields,
    projection: Callable[[], RadialProjection],
    matrix: Matrix,
    size_px: tuple[int, int],
    *,
    p1: float = 0.0,
    p2: float = 0.0,
) -> OmniCamera:
    """Camera of a calibration, flipped, up to the largest angle that its image shows.

    Args:
        fields: The file's object, for errors.
        projection: Makes the projection.
        matrix: Focal lengths and centre.
        size_px: Width and height.
        p1: Tangential distortion.
        p2: Tangential distortion.

    Raises:
        ConfigError: The model is impossible, or its centre lies far outside the image.
    """
    try:
        plane = ImagePlane((1.0, matrix.skew / matrix.fx, 0.0, matrix.fy / matrix.fx), p1, p2)
        return place_camera(
            projection(), size_px, (matrix.cx + 0.5, matrix.cy + 0.5), matrix.fx, plane
        )
    except DomainError as error:
        raise fields.make_error("model", f"a possible camera: {error}") from error


def place_camera(
    projection: RadialProjection,
    size_px: tuple[int, int],
    centre_px: tuple[float, float],
    scale_px: float,
    plane: ImagePlane,
) -> OmniCamera:
    """Camera up to the angle of its farthest corner, or to the limit of its projection.

    Raises:
        DomainError: An impossible camera, or a centre farther off the image than its size.
    """
    width, height = size_px
    if not (-width <= centre_px[0] <= 2 * width and -height <= centre_px[1] <= 2 * height):
        raise DomainError(f"a centre at {centre_px} is far outside of {width} x {height} px")
    corner_px = max(
        math.hypot(u - centre_px[0], v - centre_px[1]) for u in (0, width) for v in (0, height)
    )
    ratio = corner_px / scale_px / plane.stretch_limits[0]
    rim_rad = largest_angle_rad(projection, ratio)
    if plane.is_decentred and isinstance(projection, DistortedProjection):
        rim_rad = min(rim_rad, decentred_fold_rad(projection, plane) * WITHIN_LIMIT)
    size_px = (width, height)
    return OmniCamera(
        projection, *size_px, centre_px, scale_px, rim_rad, 0.0, Picture.FLIPPED, plane
    )


def matrix_from_camera(camera: OmniCamera, scale_px: float) -> Matrix:
    """Camera matrix of a flipped camera whose projection has another unit.

    Args:
        camera: The camera.
        scale_px: Pixels per unit of the projection that the format has.

    Raises:
        DomainError: The image plane is turned: the format has no entry below its diagonal.
    """
    a, b, c, d = camera.plane.stretch
    if c != 0.0:
        raise DomainError("a stretch with an entry below its diagonal has no camera matrix")
    u, v = camera.with_picture(Picture.FLIPPED).centre_px
    return Matrix(scale_px * a, scale_px * d, u - 0.5, v - 0.5, scale_px * b)
