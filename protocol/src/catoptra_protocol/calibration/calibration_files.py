"""Cameras from calibration files of other programs."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_protocol.calibration.calibrated_camera import read_picture_mark
from catoptra_protocol.calibration.files import MAX_BYTES, file_error, parse_document, read_mask
from catoptra_protocol.calibration.formats import FORMATS, CalibrationFormat
from catoptra_protocol.calibration.ray_table import (
    TABLE_NAME,
    fit_table,
    is_ray_table,
    read_ray_table,
)
from catoptra_protocol.calibration.templates import (
    Match,
    Mismatch,
    fields_for_readers,
    iter_objects,
    keys_of,
    match,
)
from catoptra_protocol.calibration.uncertainty import state_model_error
from catoptra_protocol.errors import ConfigError, DomainError
from catoptra_protocol.limits import MAX_IMAGE_SIDE_PX
from catoptra_protocol.names import list_names
from catoptra_protocol.optics.elementary import arctan2, hypot
from catoptra_protocol.optics.numerics import Bools, Floats, reject_overflow
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import WITHIN_LIMIT, Picture

# Of the fields that a format needs: from there on a file with a wrong number is one of it.
_MOST, _NUM_NEAREST = 0.6, 3
# Of the pixels that a mask shows: drawn circles are some pixels off the optical axis.
_MAX_LOST, _MAX_PIXELS = 0.1, 2**19


def camera_from_file(
    path: Path | str,
    *,
    camera: str = "",
    picture: Picture | None = None,
    size_px: tuple[int, int] | None = None,
) -> OmniCamera:
    """Camera of a file: see `read_calibration`."""
    return read_calibration(path, camera=camera, picture=picture, size_px=size_px)[1]


def read_calibration(
    path: Path | str,
    *,
    camera: str = "",
    picture: Picture | None = None,
    size_px: tuple[int, int] | None = None,
) -> tuple[str, OmniCamera]:
    """Name of the format and camera of a calibration file, of `FORMATS` or a ray table.

    The camera ends at the largest angle that its image shows or, where that is smaller, at the
    first fold of its model, or at the field of view or image circle that the file states, or at
    the first pixel that its mask hides.

    Args:
        path: File, at most 1 MiB but for a ray table.
        camera: Name of the camera in a file with several, such as cam1.
        picture: Hand of the pictures that the camera delivers; None: of those that the file
            describes. Other programs' files describe flipped ones, Catoptra's exports say which.
        size_px: Width and height of the images, for a file that states none.

    Raises:
        ConfigError: No readable file, no known format, or a wrong field, with file, field, value
            and expectation; or the file describes pictures of the other hand.
    """
    file = str(path)
    try:
        if is_ray_table(Path(path)):
            return TABLE_NAME, _camera_from_table(file, picture)
        data = Path(path).read_bytes()
        if len(data) > MAX_BYTES:
            expected = f"a calibration file of at most {MAX_BYTES} bytes"
            raise file_error(file, "size", expected, value=f"{len(data)} bytes")
        text = data.decode()
    except OSError as error:
        raise file_error(file, "file", f"a readable file: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise file_error(file, "file", "a text in UTF-8") from error
    found, camera_match = _find_format(text, file, camera)
    with reject_overflow(partial(file_error, file, "numbers")):
        made = _make_camera(found, camera_match, file, size_px)
        return found.name, _turn(state_model_error(made, text, file), text, file, picture)


@cache
def _read_templates() -> list[tuple[CalibrationFormat, Any, set[str]]]:
    """Formats, what readers take of their templates, and the keys of that."""
    fields = [(each, fields_for_readers(each.template)) for each in FORMATS]
    return [(each, template, keys_of(template)) for each, template in fields]


def _find_format(text: str, file: str, camera: str) -> tuple[CalibrationFormat, Match]:
    """The format that has most in common with a file, and the numbers of a camera in it.

    Raises:
        ConfigError: The file is broken, of no format, or wrong in a field; or has no such camera.
    """
    document = parse_document(text, file)
    if isinstance(document, dict) and {"intrinsics", "distortion"} <= document.keys():
        # A camera of maplab or SVO alone.
        document = {"cameras": [{"camera": document}]}
    # Most objects of a large file, such as nerfstudio's frames, have a key of no format.
    matches = [
        (each, match(template, node, path, camera))
        for path, node in iter_objects(document)
        for here in (keys_of(node),)
        for each, template, wanted in _read_templates()
        if not wanted.isdisjoint(here)
    ]
    complete = [one for one in matches if not one[1].faults]
    if complete:
        each, found = max(complete, key=lambda one: one[1].num_found)
        if camera and found.cameras and camera not in found.cameras:
            names = list_names(camera, found.cameras)
            expected = f"a camera of this {each.name} file, which has {names}"
            raise file_error(file, camera, expected, value="missing")
        return each, found
    near = sorted(matches, key=lambda one: -one[1].share_found)
    for each, found in near[:1]:
        # Another model first: its numbers are others.
        present = (fault for fault in found.faults if fault.value != "missing")
        wrong = max(present, key=lambda fault: fault.is_wrong_format, default=None)
        is_clear = found.share_found >= _MOST and (wrong is not None or len(found.faults) == 1)
        if is_clear and found.num_words > 0:
            fault = wrong or found.faults[0]
            expected = f"{fault.expected}: the file is of the format {each.name}"
            raise file_error(file, fault.key, expected, value=fault.value)
    raise _reject_format(text, file, near)


def _reject_format(
    text: str, file: str, near: list[tuple[CalibrationFormat, Match]]
) -> ConfigError:
    """Error that names the nearest formats, each with its first difference, or all of them."""
    nearest: dict[str, Mismatch] = {}
    for each, found in near:
        nearest.setdefault(each.name, found.faults[0])
    words = [
        f"{name} (needs {fault.key}: {fault.expected})"
        for name, fault in islice(nearest.items(), _NUM_NEAREST)
    ]
    if not words:
        words = [", ".join(dict.fromkeys(each.program for each in FORMATS))]
    return file_error(
        file, "format", f"a calibration file, such as {'; '.join(words)}", value=text[:40]
    )


def _make_camera(
    each: CalibrationFormat, found: Match, file: str, size_px: tuple[int, int] | None
) -> OmniCamera:
    """Camera of a file's numbers."""
    where = f"{found.path}." if found.path else ""
    width, height = (found.numbers.get(name) for name in ("width", "height"))
    if width is None or height is None:
        if size_px is None:
            expected = (
                f"ResolutionX and ResolutionY, or --size: a file of the format {each.name} may "
                "state no size, and this one states none"
            )
            raise file_error(file, f"{where}size", expected, value="missing")
        width, height = map(float, size_px)
    if not all(side.is_integer() and 1 <= side <= MAX_IMAGE_SIDE_PX for side in (width, height)):
        expected = f"whole numbers of pixels, 1 to {MAX_IMAGE_SIDE_PX}, of a file of {each.name}"
        raise file_error(file, f"{where}resolution", expected, value=f"{width} x {height}")
    try:
        camera = each.read(found.numbers, (int(width), int(height)))
    except DomainError as error:
        expected = f"a possible camera of the format {each.name}: {error}"
        raise file_error(file, f"{where}model", expected) from error
    return _narrow(camera, found.numbers["mask"], file) if "mask" in found.numbers else camera


def _narrow(camera: OmniCamera, mask: str, file: str) -> OmniCamera:
    """The camera up to the first pixel that a mask hides: it ends at one angle all around.

    Raises:
        ConfigError: No mask of this camera, or one that is no image circle.
    """
    shown = read_mask(file, mask, (camera.width_px, camera.height_px))
    near = np.pad(shown, 1)
    near = near[:-2, 1:-1] | near[2:, 1:-1] | near[1:-1, :-2] | near[1:-1, 2:]
    # Of all that is hidden, what is first from the axis has a neighbour that is shown.
    hidden, kept = (_find_angles(camera, pixels) for pixels in (near & ~shown, shown))
    rim_rad = WITHIN_LIMIT * float(hidden.min(initial=math.inf))
    lost = np.count_nonzero(kept > rim_rad) / max(kept.size, 1)
    if lost > _MAX_LOST or kept.size == 0:
        expected = (
            f"an image circle about the optical axis: {lost:.0%} of what it shows lies beyond its "
            f"first black pixel, {math.degrees(rim_rad):.1f} deg from the axis"
        )
        raise file_error(file, "mask", expected, value=mask)
    return replace(camera, rim_rad=min(rim_rad, camera.rim_rad))


def _find_angles(camera: OmniCamera, pixels: Bools) -> Floats:
    """Angles from the axis of pixels in a mask that the camera shows, of many a part."""
    places = np.flatnonzero(pixels)
    rows, columns = np.divmod(places[:: len(places) // _MAX_PIXELS + 1], camera.width_px)
    ray, valid = camera.direction_from_pixel(np.stack((columns + 0.5, rows + 0.5), axis=-1))
    return arctan2(hypot(ray[:, 0], ray[:, 1]), ray[:, 2])[valid]


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
