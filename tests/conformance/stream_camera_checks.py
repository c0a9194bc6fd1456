"""Checks of the camera model on the stream: against landmarks, rays and pictures.

A pixel of a landmark depends on the camera model, the mount and the pose of the robot, its colour
in the frame on the order of rows, columns and channels.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from catoptra_client.frame import Frame
from catoptra_client.frame_sources.stream.stream_client import LandmarkProjection, StreamClient
from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.vectors import Vector3
from conformance.check import CheckFailed, CheckSkipped, ServerUnderTest, check_from_function
from conformance.control_session import spawn_robot
from conformance.control_tour import number_of
from conformance.image_panorama import project_points
from conformance.stream_session import (
    StreamRobot,
    camera_of,
    connect_stream,
    pose_of,
    spawn_on_stream,
)

Floats = npt.NDArray[np.float64]

# Of the projection of an exact point: single precision, at most.
_PIXEL_TOLERANCE_PX = 0.25
# Of numbers with at least four decimals, pixels.
_CONF_TOLERANCE = 1e-3
_MAX_PLANS = 8
_HEIGHT_TOLERANCE_M = 0.02
# Distance to a beacon from which its bands are several pixels wide.
_VIEW_DISTANCE_M = 0.8
# Half a band must be this large in the image for the middle of its colour to be seen.
_MIN_BAND_PX = 3.0
# Saturation from which a pixel has a hue, of 1; the mean of a few pixels in any light.
_MIN_SATURATION = 0.25
# Hues of the bands are 120 degrees apart. A visible beacon's are nearest to its own, in any light;
# what hides another one may happen to have a similar hue.
_NEAREST_HUE_DEG, _SAME_HUE_DEG = 60.0, 30.0
_HUES_DEG = {"yellow": 60.0, "cyan": 180.0, "magenta": 300.0}


def check_camera_model(server: ServerUnderTest) -> None:
    """Camera model of get_camera and of frames are one, at the height that it states."""
    with spawn_on_stream(server) as robot:
        frame = robot.get_frame()
        if not isinstance(frame.camera, OmniCamera) or frame.robot_from_mirror is None:
            raise CheckSkipped("the camera is not omnidirectional")
        by_request, height_m = robot.client.get_camera_and_height(frame.camera_name or "")
    if by_request != frame.camera:
        raise CheckFailed(f"get_camera states {by_request}, a frame of it {frame.camera}")
    viewpoint = (pose_of(frame) @ frame.robot_from_mirror).translation
    # z points down; the floor is z = 0 where the robot is upright on level ground.
    if abs(height_m + viewpoint[2]) > _HEIGHT_TOLERANCE_M:
        raise CheckFailed(
            f"ViewpointHeight is {height_m:g} m, by world_from_robot and robot_from_mirror it is "
            f"{-viewpoint[2]:g} m above the floor"
        )


def check_camera_bound(server: ServerUnderTest) -> None:
    """CONF has the error bound of a frame, and none before a frame with new settings."""
    if "control" not in server.addresses:
        raise CheckSkipped("no control port")
    with spawn_robot(server) as session, connect_stream(server) as client:
        confs = [one for one in session.query("GETCONF {Type Camera}") if one.get("Mirror")]
        if not confs:
            raise CheckSkipped(f"{server.robot_class} has no camera with a mirror")
        camera, state = confs[0].get("Name") or "", client.get_state()
        # A tolerance of this moment: no frame was ever requested with it.
        target = f"{{Opcode MaxError}} {{Params {1.0 + state.time_s % 1.0:.4f}}}"
        session.query(f"SET {{Type Camera}} {{Name {camera}}} {target}")
        get_conf = f"GETCONF {{Type Camera}} {{Name {camera}}}"
        (before,) = session.query(get_conf)
        # The plan for a target may change with the first frames.
        for _ in range(_MAX_PLANS):
            frame = client.get_frame(robot=state.robots[-1].name, camera=camera)
            (after,) = session.query(get_conf)
            bound_px, stated_px = frame.error_bound_px, number_of(after, "ErrorBoundPx")
            if abs((stated_px or 0.0) - (bound_px or 0.0)) <= _CONF_TOLERANCE:
                break
    if before.get("ErrorBoundPx") or before.get("ErrorRmsPx"):
        raise CheckFailed("CONF has an ErrorBoundPx of settings that no frame has had yet")
    if frame.camera != omni_camera_from_pairs(after.pairs)[0]:
        raise CheckSkipped("CONF states the camera in its tile")
    if bound_px is stated_px is None:
        raise CheckSkipped("neither CONF nor a frame has a bound")
    if bound_px is None or stated_px is None or abs(stated_px - bound_px) > _CONF_TOLERANCE:
        raise CheckFailed(f"{after}: error_bound_px of a frame is {bound_px}")


def check_landmark_pixels(server: ServerUnderTest) -> None:
    """Pixels of landmarks are their places, by camera model, mount and pose of a frame."""
    for _, frame, projections in _visit_beacons(server):
        for one in projections:
            expected = _project(frame, one.landmark)
            if one.pixel is None or expected is None:
                if one.visible:
                    raise CheckFailed(f"{one.landmark.name} is visible, but outside the image")
                continue
            error_px = math.dist(one.pixel, expected)
            if error_px > _PIXEL_TOLERANCE_PX:
                raise CheckFailed(
                    f"{one.landmark.name} is at the pixel {_format(one.pixel)}, by the camera "
                    f"model and the pose of a frame at {_format(expected)}"
                )


def check_landmark_colours(server: ServerUnderTest) -> None:
    """A frame shows the colours of each visible beacon at its pixel, and of no hidden one."""
    num_seen = 0
    for _, frame, projections in _visit_beacons(server):
        for one in projections:
            bands = _band_colours(frame, one.landmark)
            if one.landmark.kind != "beacon" or bands is None:
                continue
            hues = [_hue_deg(rgb) for rgb in bands]
            expected = (one.landmark.lower_colour, one.landmark.upper_colour)
            tolerance_deg = _NEAREST_HUE_DEG if one.visible else _SAME_HUE_DEG
            shows = all(
                _has_hue(hue, colour, tolerance_deg)
                for hue, colour in zip(hues, expected, strict=True)
            )
            if shows != one.visible:
                raise CheckFailed(
                    f"{one.landmark.name} is {'' if one.visible else 'not '}visible: at its pixel "
                    f"{expected[0]} below {expected[1]} is {'' if one.visible else 'not '}expected,"
                    f" the frame shows RGB {_format(bands[0])} below {_format(bands[1])}"
                )
            num_seen += shows
    if not num_seen:
        raise CheckSkipped("no beacon is near enough to show its colours")


def _visit_beacons(
    server: ServerUnderTest,
) -> Iterator[tuple[StreamRobot, Frame, tuple[LandmarkProjection, ...]]]:
    """A robot near two beacons, one after the other, a frame, and the projections of landmarks."""
    with connect_stream(server) as client:
        poses = _viewing_poses(client)
    for location_m, yaw_rad in poses:
        with spawn_on_stream(server, location_m, yaw_rad) as robot:
            frame = robot.get_frame_after(robot.wait_until_standing())
            yield robot, frame, robot.client.get_landmark_projections(robot.name)


def _viewing_poses(client: StreamClient) -> list[tuple[Vector3, float]]:
    """Places between the centre of all landmarks and two beacons, with different headings."""
    landmarks = client.get_landmarks()
    beacons = [one for one in landmarks if one.kind == "beacon"]
    if not beacons:
        raise CheckSkipped("the world has no beacons")
    centre = np.mean([(one.x_m, one.y_m) for one in landmarks], axis=0)
    poses: list[tuple[Vector3, float]] = []
    for yaw_rad, beacon in zip((0.5, 2.0), (beacons[0], beacons[-1]), strict=True):
        place = np.array((beacon.x_m, beacon.y_m))
        away = centre - place
        place = place + _VIEW_DISTANCE_M * away / max(float(np.linalg.norm(away)), 1e-9)
        poses.append(((float(place[0]), float(place[1]), 0.0), yaw_rad))
    return poses


def _band_points(landmark: Landmark) -> Floats:
    """Middle of the lower colour, centre of the band, middle of the upper one: world frame."""
    bottom, top = landmark.band_bottom_m, landmark.band_top_m
    heights = (bottom + fraction * (top - bottom) for fraction in (0.25, 0.5, 0.75))
    return np.array([(landmark.x_m, landmark.y_m, -height) for height in heights])


def _points_in_camera(frame: Frame, points: Floats) -> Floats:
    if frame.robot_from_mirror is None:
        raise CheckFailed(f"frame {frame.sequence} of one camera has no robot_from_mirror")
    world_from_camera = pose_of(frame) @ frame.robot_from_mirror
    in_camera: Floats = world_from_camera.inverse().transform_points(points)
    return in_camera


def _project(frame: Frame, landmark: Landmark) -> tuple[float, float] | None:
    """Pixel of the centre of a landmark's band; None outside the image."""
    pixels, inside = _project_points(frame, _band_points(landmark)[1:2])
    return (float(pixels[0, 0]), float(pixels[0, 1])) if inside.all() else None


def _project_points(frame: Frame, points: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
    camera = camera_of(frame)
    pixels, valid = project_points(camera, _points_in_camera(frame, points))
    inside = (pixels >= 0.0).all(axis=1) & (pixels <= (camera.width_px, camera.height_px)).all(1)
    return pixels, valid & inside


def _band_colours(frame: Frame, landmark: Landmark) -> tuple[Floats, Floats] | None:
    """Colours in the middle of the lower and the upper half of a beacon's band.

    None outside the image, or where the halves are too small to have a middle.
    """
    pixels, inside = _project_points(frame, _band_points(landmark))
    if not inside.all() or math.dist(pixels[0], pixels[2]) < _MIN_BAND_PX:
        return None
    colours = []
    for u, v in (pixels[0], pixels[2]):
        row, column = int(v), int(u)
        around = frame.rgb[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        colours.append(np.median(around.reshape(-1, 3), axis=0))
    return colours[0], colours[1]


def _hue_deg(rgb: Floats) -> float:
    """Hue; NaN for a colour near grey."""
    low, high = float(rgb.min()), float(rgb.max())
    if high - low < _MIN_SATURATION * max(high, 1.0):
        return math.nan
    red, green, blue = rgb
    return math.degrees(math.atan2(math.sqrt(3.0) * (green - blue), 2.0 * red - green - blue))


def _has_hue(hue_deg: float, colour: str, tolerance_deg: float) -> bool:
    return abs(math.remainder(hue_deg - _HUES_DEG[colour], 360.0)) < tolerance_deg


def _format(numbers: Floats | tuple[float, ...]) -> str:
    return ", ".join(f"{float(number):.1f}" for number in numbers)


CAMERA_CHECKS = (
    check_from_function("stream_camera_model", "stream", check_camera_model),
    check_from_function("stream_camera_bound", "stream", check_camera_bound),
    check_from_function("stream_landmark_pixels", "stream", check_landmark_pixels),
    check_from_function("stream_landmark_colours", "stream", check_landmark_colours),
)
