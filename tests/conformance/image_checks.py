"""Checks of the image port: complete encodings, regions, and pictures against the robot's motion.

The picture is that of the first robot with a camera, so the robot of a check must be the only one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction

import cv2
import numpy as np

from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.stream.requests import ImageEncoding
from conformance.check import (
    Check,
    CheckFailed,
    CheckSkipped,
    ServerUnderTest,
    check_from_function,
    retry_once,
)
from conformance.control_drive import describe, drive_until, require_sides
from conformance.control_readings import read_number
from conformance.control_session import ControlSession, spawn_robot
from conformance.image_panorama import Pixels, choose_turn, panorama_from_picture, require_turn
from conformance.image_session import ImageSession, connect_images

# Wheel speed of a turn, of the maximum.
_TURN_PERCENT = 25.0
# Of 2 % of the values of two codings of one picture, blurred: measured in the bundled worlds, 12 by
# JPEG of quality 10, at least 35 by exchanged colours, 76 by a flipped picture.
_CODING_LEVELS = 20.0
_CODING_QUANTILE = 0.98
_CODING_BLUR_PX = 3.0
# A region of this part of the picture's sides.
_REGION_PART = Fraction(1, 4)
# Regions are searched in the picture at this distance from the place that was requested.
_SEARCH_PX = 24
# Standard deviation of the mean levels of blocks of this size, below which a picture shows nothing.
_BLOCK_PX = 16
_MIN_CONTRAST_LEVELS = 2.0
# One that was drawn ahead, one that was under way.
_MAX_EARLY_FRAMES = 2


@contextmanager
def _show_robot(server: ServerUnderTest) -> Iterator[tuple[ControlSession, ImageSession]]:
    """Spawn a robot with a camera for the length of a block, and connect to both ports."""
    with spawn_robot(server) as control:
        if not any(one.get("Name") for one in control.query("GETCONF {Type Camera}")):
            raise CheckSkipped(f"{server.robot_class} has no camera")
        with connect_images(server) as images:
            _skip_early_frames(images)
            yield control, images


def _skip_early_frames(images: ImageSession) -> None:
    """Take the frames that may show the time before the robot was spawned.

    A busy server may deliver what it exposed before INIT: frames are as old as drawing one takes.
    """
    for _ in range(_MAX_EARLY_FRAMES):
        if _has_contrast(images.get_picture()):
            return


def check_picture(server: ServerUnderTest) -> None:
    """A frame is encoded completely, and shows something."""
    with _show_robot(server) as (_, images):
        rgb = images.get_picture()
        if _has_contrast(rgb):
            return
        if "stream" in server.addresses and not _has_contrast(_get_stream_picture(server)):
            raise CheckSkipped("the world looks the same everywhere: is it dark?")
    raise CheckFailed(
        f"a picture of {rgb.shape[1]} x {rgb.shape[0]} px in one colour: expected what the camera "
        "of the robot sees"
    )


def check_region(server: ServerUnderTest) -> None:
    """A region is the part of the full frame that was requested, to the pixel."""
    with _show_robot(server) as (_, images):
        full = images.get_picture()
        height, width = (max(8, int(side * _REGION_PART)) for side in full.shape[:2])
        x, y = _find_detail(full, width, height)
        # Another one first: a server may serve the last region instead.
        images.get_region(width, height, 2 * height, height)
        region = images.get_region(x, y, width, height)
    if region.shape != (height, width, 3):
        raise CheckFailed(
            f"U {x} {y} {width} {height}: a region of {region.shape[1]} x {region.shape[0]} px"
        )
    left, top = max(x - _SEARCH_PX, 0), max(y - _SEARCH_PX, 0)
    surroundings = full[top : y + height + _SEARCH_PX, left : x + width + _SEARCH_PX]
    costs = cv2.matchTemplate(surroundings, region, cv2.TM_SQDIFF)
    row, column = np.unravel_index(int(costs.argmin()), costs.shape)
    found = left + int(column), top + int(row)
    if found != (x, y):
        raise CheckFailed(
            f"U {x} {y} {width} {height}: the region is that at {found[0]} {found[1]}"
        )
    require_equal_pictures(full[y : y + height, x : x + width], region, "full frame and region")


def check_turn(server: ServerUnderTest) -> None:
    """When the robot turns right, the picture shows the surroundings moving left as far."""
    with _show_robot(server) as (control, images):
        camera = _read_camera(control, images)
        require_sides(control)
        before = panorama_from_picture(_get_camera_picture(images, camera), camera)
        turn_rad = choose_turn(camera)
        # So slowly that an ordinary camera still sees a part of its old view.
        motions = drive_until(
            control, _TURN_PERCENT, -_TURN_PERCENT, lambda motion: abs(motion.yaw_rad) >= turn_rad
        )
        after = panorama_from_picture(_get_camera_picture(images, camera), camera)
    yaw_rad = float(np.median([motion.yaw_rad for motion in motions.values()]))
    require_turn(before, after, yaw_rad, describe(motions))


@retry_once
def check_stream_picture(server: ServerUnderTest) -> None:
    """The picture of the image port is the one that the stream has of it, without loss."""
    if "stream" not in server.addresses:
        raise CheckSkipped("no stream")
    with _show_robot(server) as (_, images):
        lossless = _get_stream_picture(server)
        require_equal_pictures(lossless, images.get_picture(), "stream and image port")


def require_equal_pictures(first: Pixels, second: Pixels, names: str) -> None:
    """Fail where two codings of one picture differ by more than coding and noise."""
    if first.shape != second.shape:
        raise CheckFailed(f"{names} have {first.shape[1::-1]} and {second.shape[1::-1]} px")
    # Single pixels at edges differ by coding and by the moment; the blur leaves what is wrong.
    one, other = (
        cv2.GaussianBlur(rgb, (0, 0), _CODING_BLUR_PX).astype(np.float64) for rgb in (first, second)
    )
    levels = float(np.quantile(np.abs(one - other), _CODING_QUANTILE))
    if levels > _CODING_LEVELS:
        raise CheckFailed(
            f"{names} must show the same: 2 % of their values differ by {levels:.0f} of 255 levels "
            f"or more, expected at most {_CODING_LEVELS:g}"
        )


def _get_stream_picture(server: ServerUnderTest) -> Pixels:
    """Image-port picture by the stream, without loss."""
    host, port = server.addresses["stream"]
    with StreamClient.connect(host, port) as stream:
        return stream.get_frame(encoding=ImageEncoding.PNG).rgb


def _has_contrast(rgb: Pixels) -> bool:
    """Whether a picture shows anything."""
    if not rgb.size:
        return False
    # Means of blocks: a JPEG of zeros shows the same pattern in each.
    blocks = [max(1, side // _BLOCK_PX) for side in rgb.shape[1::-1]]
    means = cv2.resize(rgb.astype(np.float32), blocks, interpolation=cv2.INTER_AREA)
    return float(means.std(axis=(0, 1)).max()) >= _MIN_CONTRAST_LEVELS


def _find_detail(rgb: Pixels, width: int, height: int) -> tuple[int, int]:
    """Corner (x, y) of the region with most detail in both directions.

    Raises:
        CheckSkipped: No region has a detail by which it can be found.
    """
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    rows, columns = (np.abs(np.diff(grey, axis=axis)) for axis in (0, 1))
    best, corner = 0.0, (0, 0)
    for y in range(0, rgb.shape[0] - height + 1, 7):
        for x in range(0, rgb.shape[1] - width + 1, 7):
            part = slice(y, y + height - 1), slice(x, x + width - 1)
            detail = float(min(rows[part].mean(), columns[part].mean()))
            if detail > best:
                best, corner = detail, (x, y)
    if best == 0.0:
        raise CheckSkipped("the picture has no detail by which a region can be found")
    return corner


def _read_camera(control: ControlSession, images: ImageSession) -> OmniCamera | PerspectiveCamera:
    """Model of the first omnidirectional camera, or else of the first one, as CONF states it."""
    confs = [one for one in control.query("GETCONF {Type Camera}") if one.get("Name")]
    for conf in confs:
        # A camera without a field of view on a plane: its CameraFov is 0.
        if conf.get("Mirror") is not None or conf.get("Lens") is not None:
            return omni_camera_from_pairs(tuple(conf.pairs))[0]
    height, width = images.get_picture().shape[:2]
    return PerspectiveCamera(width, height, math.radians(read_number(confs[0], "CameraFov")))


def _get_camera_picture(images: ImageSession, camera: OmniCamera | PerspectiveCamera) -> Pixels:
    """Picture of the camera: with tiles the first one, which is that of the first robot."""
    return images.get_picture()[: camera.height_px, : camera.width_px]


IMAGE_CHECKS: tuple[Check, ...] = (
    check_from_function("image_picture", "image", check_picture),
    check_from_function("image_region_content", "image", check_region),
    check_from_function("image_turn", "image", check_turn),
    check_from_function("image_stream_picture", "image", check_stream_picture),
)
