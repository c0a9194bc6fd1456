"""Frames to look at: the panorama of a frame, image files, and frames in a notebook."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from catoptra_client.frame import Frame, Pixels, image_bytes_from_rgb
from catoptra_client.unwarp import CylinderGeometry, make_unwarp_map, unwarp
from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera

_PANORAMA_COLUMNS = 1080
# Slopes of 50 degrees below the horizon and, for mirrors that show as much, above it: beyond, a
# cylinder stretches what it shows.
_STEEPEST_SLOPE = 1.2
# Cosine of the tilt up to which a camera's axis is the robot's vertical.
_LEVEL = 1.0 - 1e-6
_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")


def make_panorama(frame: Frame, columns: int = _PANORAMA_COLUMNS) -> Pixels:
    """Unwarp all that a frame shows onto a cylinder about the robot's vertical, its middle ahead.

    Args:
        frame: Frame of an omnidirectional camera, with its camera model, as the stream sends it.
        columns: Width of the panorama, pixels; the height follows from square pixels.

    Returns:
        (rows, columns, 3) uint8 RGB.

    Raises:
        DomainError: The frame has no omnidirectional camera model.
    """
    if not isinstance(frame.camera, OmniCamera):
        raise DomainError(
            "a panorama needs a frame with the model of an omnidirectional camera, as the stream "
            "sends it for a robot and camera; the image port sends no model"
        )
    mount = None if frame.robot_from_mirror is None else frame.robot_from_mirror.rotation
    cylinder = choose_cylinder(frame.camera, columns, robot_from_mirror=mount)
    return unwarp(frame.rgb, make_unwarp_map(frame.camera, cylinder, robot_from_mirror=mount))


def choose_cylinder(
    camera: OmniCamera, columns: int, *, robot_from_mirror: Floats | None = None
) -> CylinderGeometry:
    """Cylinder of square pixels, from the rim of a camera to 50 degrees below the horizon.

    A band below the rim where the camera shows nothing above these 50 degrees. From 50 degrees
    above the horizon for a camera that does not look down.

    Args:
        camera: Model of the camera.
        columns: Width, pixels.
        robot_from_mirror: (3, 3) rotation of the mirror frame on the robot; None: none.
    """
    looks_down = robot_from_mirror is None or robot_from_mirror[2, 2] > _LEVEL
    rim_slope = 1.0 / math.tan(camera.rim_rad) if looks_down else -math.inf
    top_slope = max(rim_slope, -_STEEPEST_SLOPE)
    bottom_slope = max(_STEEPEST_SLOPE, top_slope + 1.0)
    rows = round((bottom_slope - top_slope) * columns / (2.0 * math.pi))
    return CylinderGeometry(columns, max(rows, 1), top_slope, bottom_slope)


def write_image(path: Path, rgb: Pixels) -> None:
    """Write (h, w, 3) RGB pixels as a PNG or JPEG file, by the suffix of its name.

    Raises:
        CatoptraError: The suffix names another format, or there are no pixels.
        OSError: The file cannot be written.
    """
    if path.suffix.lower() not in _IMAGE_SUFFIXES:
        names = ", ".join(_IMAGE_SUFFIXES)
        raise CatoptraError(f"{path}: the name of an image file ends with one of {names}")
    path.write_bytes(image_bytes_from_rgb(rgb, path.suffix.lower()))


@dataclass(frozen=True, slots=True, eq=False)
class FrameView:
    """A frame as a notebook displays it: the picture and, if its camera is known, the panorama."""

    picture: Pixels
    """(h, w, 3) uint8 RGB."""
    panorama: Pixels | None
    """(rows, columns, 3) uint8 RGB; None for frames of other cameras or of the image port."""

    def _repr_png_(self) -> bytes:
        """PNG file of the picture above the panorama, the notebook's own name for it."""
        if self.panorama is None:
            return image_bytes_from_rgb(self.picture, ".png")
        width = max(self.picture.shape[1], self.panorama.shape[1])
        rows = (_centre_in_width(self.picture, width), _centre_in_width(self.panorama, width))
        return image_bytes_from_rgb(np.concatenate(rows), ".png")


def _centre_in_width(rgb: Pixels, width: int) -> Pixels:
    """Image between black borders."""
    left = (width - rgb.shape[1]) // 2
    right = width - rgb.shape[1] - left
    return np.pad(rgb, ((0, 0), (left, right), (0, 0)))


def show(frame: Frame) -> FrameView:
    """View of a frame that a notebook displays: picture and, where possible, panorama."""
    is_omnidirectional = isinstance(frame.camera, OmniCamera) and frame.rgb.size > 0
    return FrameView(frame.rgb, make_panorama(frame) if is_omnidirectional else None)
