"""Cameras from calibration files of other programs."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from catoptra_protocol.calibration.calibrated_camera import read_picture_mark
from catoptra_protocol.calibration.files import MAX_BYTES, file_error
from catoptra_protocol.calibration.formats import FORMATS
from catoptra_protocol.calibration.ray_table import fit_table, is_ray_table, read_ray_table
from catoptra_protocol.calibration.uncertainty import state_model_error
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import reject_overflow
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture


def camera_from_file(
    path: Path | str, *, camera: str = "", picture: Picture | None = None
) -> OmniCamera:
    """Camera of a calibration file of any format in `FORMATS`, or of a ray table.

    The camera ends at the largest angle that its image shows or, where that is smaller, at the
    first fold of its model.

    Args:
        path: File, at most 1 MiB but for a ray table.
        camera: Name of the camera in a file with several, such as cam1.
        picture: Hand of the pictures that the camera delivers; None: of those that the file
            describes. Other programs' files describe flipped ones, Catoptra's exports say which.

    Raises:
        ConfigError: No readable file, no known format, or a wrong field, with file, field, value
            and expectation; or the file describes pictures of the other hand.
    """
    file = str(path)
    try:
        if is_ray_table(Path(path)):
            return _camera_from_table(file, picture)
        data = Path(path).read_bytes()
        if len(data) > MAX_BYTES:
            expected = f"a calibration file of at most {MAX_BYTES} bytes"
            raise file_error(file, "size", expected, value=f"{len(data)} bytes")
        text = data.decode()
    except OSError as error:
        raise file_error(file, "file", f"a readable file: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise file_error(file, "file", "a text in UTF-8") from error
    for each in FORMATS:
        if each.is_format(text):
            with reject_overflow(partial(file_error, file, "numbers")):
                found = state_model_error(each.read(text, file, camera), text, file)
                return _turn(found, text, file, picture)
    names = ", ".join(each.NAME for each in FORMATS)
    raise file_error(file, "format", f"a file of {names}", value=text[:40])


def _turn(camera: OmniCamera, text: str, file: str, picture: Picture | None) -> OmniCamera:
    """The camera with the hand of its pictures.

    Raises:
        ConfigError: The file describes pictures of the other hand.
    """
    described = read_picture_mark(text, file)
    if described is None:
        return camera.with_picture(picture or Picture.FLIPPED)
    return _match_picture(camera, described, file, picture)


def _camera_from_table(file: str, picture: Picture | None) -> OmniCamera:
    """Camera of a ray table, as a measured lens."""
    table = read_ray_table(file)
    try:
        camera = fit_table(table)
    except DomainError as error:
        raise file_error(file, "direction", f"a possible camera: {error}") from error
    return _match_picture(camera, table.picture, file, picture)


def _match_picture(
    camera: OmniCamera, described: Picture, file: str, picture: Picture | None
) -> OmniCamera:
    """The same of a file that says which pictures it describes."""
    if picture is not None and picture is not described:
        expected = (
            f"a file of {picture.value} pictures, which this camera delivers; "
            f"catoptra-server calibration --picture {picture.value} writes it"
        )
        raise file_error(file, "catoptra_picture", expected, value=described.value)
    if described is Picture.FLIPPED:
        return camera
    # Read as if the pictures were flipped: their frame's x points left.
    return replace(camera, picture=described, plane=camera.plane.mirror())
