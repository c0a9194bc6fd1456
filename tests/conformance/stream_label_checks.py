"""Checks of labels: channels against camera model, poses, landmarks, objects and get_pixel.

Ranges, points, normals and numbers of one frame describe one world, which another frame, the list
of landmarks and single rays describe too.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from catoptra_client.frame import Frame
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels import LABEL_CHANNELS, LabelledObject
from catoptra_protocol.optics.camera_rays import pixel_from_point, rays_from_pixel_grid
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.replies import FrameHeader, LandmarksReply, PixelReply
from catoptra_protocol.stream.requests import (
    ChannelEncoding,
    FrameVariant,
    GetFrameRequest,
    GetLandmarksRequest,
    GetPixelRequest,
    ImageEncoding,
)
from conformance.check import Check, CheckFailed, CheckSkipped, ServerUnderTest, check_from_function
from conformance.stream_session import (
    StreamRobot,
    ask,
    connect_stream,
    pose_of,
    require,
    spawn_on_stream,
)

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

# Ranges are float32; a mirror's rays may be those of a table.
_POINT_TOLERANCE_M = 0.01
_NORMAL_TOLERANCE = 1e-3
# Of the pixels: those at edges, which a ray a hair's breadth away decides otherwise.
_MOST = 0.98
_FLOW_TOLERANCE_PX = 0.3
_PIXEL_STEP = 29
_TURN_RAD = 0.15
_TICK_S = 0.06
# Later than four frames of a busy server.
_HALT_S = 10.0
# A prism of many sides in the place of a cylinder.
_BOX_TOLERANCE_M = 0.02
_HEIGHT_TOLERANCE_M = 0.015


def check_label_geometry(server: ServerUnderTest) -> None:
    """Ranges, points and normals of labels lie on the rays of the camera model."""
    with spawn_on_stream(server, *_near_beacon(server)) as robot:
        frame = _get_labels(robot, robot.wait_until_standing())
        reply = ask(robot.client, GetPixelRequest, PixelReply, robot.name, "", 0.5, 0.5)
    channels, (origins, directions, valid) = _channels(frame), _rays(frame)
    require(np.array_equal(channels["valid"], valid), True, "valid, by the camera model")
    require(valid[0, 0] == (reply.theta_rad is not None), True, "get_pixel in the corner")
    met = np.isfinite(channels["range"])
    require(bool((met <= valid).all()) and bool(met.any()), True, "ranges within valid pixels")
    ranges = channels["range"].astype(np.float64)[met]
    if (ranges <= 0.0).any():
        raise CheckFailed(f"a range of {ranges.min():g} m")
    mount = pose_of(frame) @ (frame.robot_from_mirror or Pose.identity())
    points = mount.transform_points(origins[met] + ranges[:, None] * directions[met])
    _require_near(points, channels["point"][met], _POINT_TOLERANCE_M, "points, by the ranges")
    require(bool(np.isnan(channels["point"][~met]).all()), True, "points of nothing")
    normals = channels["normal"].astype(np.float64)[met]
    lengths = np.linalg.norm(normals, axis=1)
    require(bool((abs(lengths - 1.0) < _NORMAL_TOLERANCE).all()), True, "unit normals")
    facing = (normals * directions[met]).sum(axis=1)
    require(bool((facing < _NORMAL_TOLERANCE).mean() > _MOST), True, "normals towards the origin")
    _require_normals(channels, mount, met)
    require(bool(((channels["ids"] > 0) == met).mean() > _MOST), True, "ids where a range is")
    labels = frame.labels
    if labels is None:
        raise CheckFailed("no labels")
    # Of a standing robot both times are one; a displaced camera's rays are others.
    require(labels.is_displaced, False, "is_displaced of labels on the exact rays")


def check_label_objects(server: ServerUnderTest) -> None:
    """Boxes of objects contain their points; landmarks are objects; numbers name classes."""
    with spawn_on_stream(server, *_near_beacon(server)) as robot:
        frame = _get_labels(robot, robot.wait_until_standing())
        landmarks = robot.client.get_landmarks()
    _require_objects(frame, robot.name)
    channels, objects = _channels(frame), _objects(frame)
    ids = channels["ids"]
    agreement = channels["agreement"]
    interior = _interior(ids)
    require(bool((agreement[interior] == 255).mean() > _MOST), True, "agreement inside objects")
    edges = (ids > 0) & ~interior
    require(bool((agreement[edges] < 255).any()), True, "agreement at edges")
    require(bool(agreement[ids == 0].any()), False, "agreement of nothing")
    by_name = {one.name: one for one in objects}
    found = [(by_name[one.name], one) for one in landmarks if one.name in by_name]
    require(bool(found) or not landmarks, True, "a landmark among the objects in view")
    for box, one in found:
        require(box.class_name, one.kind, f"class of {one.name}")
        place = box.world_from_box.transform_points(np.zeros(3))
        reach_m = math.dist(place[:2], (one.x_m, one.y_m))
        depth_m = one.depth_m if one.kind == "goal" else 0.0
        height_m = float(box.half_size_m[2] - place[2])
        sides_m = [2.0 * float(size) for size in box.half_size_m[:2]]
        bottom_m = -float(place[2] + box.half_size_m[2])
        if abs(reach_m - depth_m / 2.0) > _BOX_TOLERANCE_M + 0.02:
            raise CheckFailed(f"the box of {one.name} is {reach_m:.3f} m away from the landmark")
        if one.band_bottom_m >= one.band_top_m or not (
            abs(height_m - one.band_top_m) < _HEIGHT_TOLERANCE_M > abs(bottom_m)
        ):
            raise CheckFailed(f"the box of {one.name} is {height_m:.2f} m high: {one}")
        # A beacon is round; walls around its mouth make a goal wider.
        expected = (one.width_m, one.width_m) if one.kind == "beacon" else (depth_m, one.width_m)
        for side_m, true_m in zip(sides_m, expected, strict=True):
            if abs(side_m - true_m) > 0.05 * true_m + 0.05 * (one.kind == "goal"):
                raise CheckFailed(f"the box of {one.name} has the sides {sides_m} m: {one}")


def _require_objects(frame: Frame, robot: str) -> None:
    """Fail where ids, classes and points of a frame are not those of its objects."""
    channels = _channels(frame)
    objects = _objects(frame)
    ids = channels["ids"]
    numbers = [one.number for one in objects]
    require(numbers, sorted(set(numbers)), "ascending numbers of objects")
    require(set(np.unique(ids[ids > 0]).tolist()), set(numbers), "objects of the channel ids")
    names = {one.class_number: one.class_name for one in objects}
    require(len(set(names.values())), len(names), "names of classes")
    require(min(names) > 0 and all(names.values()), True, "numbers and names of classes")
    require(names, {one.class_number: one.class_name for one in reversed(objects)}, "class names")
    for one in objects:
        seen = ids == one.number
        classes = np.unique(channels["classes"][seen]).tolist()
        require(classes, [one.class_number], f"classes of {one.name}")
        inside = one.world_from_box.inverse().transform_points(
            channels["point"][seen].astype(np.float64)
        )
        excess_m = float((abs(inside) - one.half_size_m).max())
        if excess_m > _BOX_TOLERANCE_M:
            raise CheckFailed(f"a point of {one.name} is {excess_m:.3f} m outside its box")
        _require_rotation(one)
        if one.name == robot:
            require(one.class_name, "robot", "class of a robot")
            pose = pose_of(frame)
            turn = abs(one.world_from_box.rotation - pose.rotation).max()
            away_m = float(np.linalg.norm((one.world_from_box.translation - pose.translation)[:2]))
            require(turn < 0.02 and away_m < 0.3, True, f"box of the own robot: {away_m:.2f} m")


def check_label_motion(server: ServerUnderTest) -> None:
    """Flow leads each point to its pixel in the frame before, also of a robot that moved."""
    with spawn_on_stream(server, *_near_beacon(server)) as robot:
        standing_s = robot.wait_until_standing()
        before = _get_labels(robot, standing_s, ("flow", "point", "ids", "classes"))
        robot.turn_right(_TURN_RAD)
        after = _get_labels(robot, standing_s, ("flow", "point", "ids", "classes"))
    first, second = before.labels, after.labels
    if not isinstance(after.camera, OmniCamera):
        raise CheckSkipped("the camera is not omnidirectional")
    if first is None or second is None:
        raise CheckFailed("no labels")
    _require_objects(before, robot.name)
    _require_objects(after, robot.name)
    require(second.flow_to_time_s, before.time_s, "flow_to_time_s, of the frame before")
    channels = _channels(after)
    rows, columns = np.nonzero(np.isfinite(channels["flow"]).all(axis=-1))
    require(len(rows) > 100, True, "pixels with flow")
    # What turns with the robot keeps its pixel.
    objects = {one.number: one.class_name for one in _objects(after)}
    ids = channels["ids"][rows, columns]
    fixed = np.array([objects.get(int(number)) != "robot" for number in ids])
    rows, columns = rows[fixed], columns[fixed]
    points = channels["point"][rows, columns].astype(np.float64)
    mount = pose_of(before) @ (before.robot_from_mirror or Pose.identity())
    old, inside = pixel_from_point(after.camera, mount.inverse().transform_points(points))
    moved = np.stack([columns, rows], axis=1) + 0.5 + channels["flow"][rows, columns]
    errors = np.linalg.norm(moved - old, axis=1)[inside]
    if float(np.quantile(errors, _MOST)) > _FLOW_TOLERANCE_PX:
        raise CheckFailed(f"flow misses its points by up to {np.quantile(errors, _MOST):.2f} px")


def check_moving_labels(server: ServerUnderTest) -> None:
    """Labels of a driving robot fit the pose of their frame, or are of each row's time."""
    with spawn_on_stream(server, *_near_beacon(server)) as robot:
        robot.client.drive(-1.5, 1.5, halt_after_s=_HALT_S)
        frames = [_get_labels(robot, 0.0, ("range", "point")) for _ in range(4)]
        robot.client.drive(0.0, 0.0)
    for frame in frames:
        labels = frame.labels
        if labels is None or labels.has_row_times:
            shutter = [one.name for one in frame.effects if one.enabled and "Shutter" in one.name]
            require(bool(shutter), True, "a rolling shutter, since the labels are of rows")
            continue
        channels, (origins, directions, _) = _channels(frame), _rays(frame)
        met = np.isfinite(channels["range"])
        mount = pose_of(frame) @ (frame.robot_from_mirror or Pose.identity())
        ranges = channels["range"].astype(np.float64)[met]
        points = mount.transform_points(origins[met] + ranges[:, None] * directions[met])
        _require_near(
            points, channels["point"][met], _POINT_TOLERANCE_M, "points of a moving robot"
        )


def check_label_encodings(server: ServerUnderTest) -> None:
    """Channels are the same raw and compressed, and in the order of the table."""
    with spawn_on_stream(server) as robot:
        standing_s = robot.wait_until_standing()
        names = ("classes", "ids", "range")
        raw = _get_labels(robot, standing_s, names)
        packed = _get_labels(robot, standing_s, names, ChannelEncoding.ZLIB)
        values = robot.name, "", ImageEncoding.RAW, None, names
        request = GetFrameRequest(next(robot.client._ids), *values)
        header, parts = robot.client._exchange(request, FrameHeader, "a frame")
    labels = header.labels
    if labels is None:
        raise CheckFailed("a frame without labels, of a request with channels")
    require(labels.times in ("middle", "rows"), True, f"times {labels.times}")
    sizes = [len(part) for part in parts[1:]]
    require([one.num_bytes for one in labels.channels], sizes, "num_bytes of parts")
    for name in names:
        same = np.array_equal(_channels(raw)[name], _channels(packed)[name])
        require(same, True, f"raw and compressed {name}")
    require(list(_channels(raw)), ["range", "ids", "classes"], "order of channels")
    objects = [(one.number, one.name, one.class_name) for one in _objects(raw)]
    others = [(one.number, one.name, one.class_name) for one in _objects(packed)]
    require(objects, others, "objects of two frames")


def check_pixels(server: ServerUnderTest) -> None:
    """get_pixel states direction, range, object and bound as labels and frames do."""
    with spawn_on_stream(server, *_near_beacon(server)) as robot:
        standing_s = robot.wait_until_standing()
        frame = _get_labels(robot, standing_s, ("range", "ids"))
        height, width = frame.rgb.shape[:2]
        places = [
            (row, column)
            for row in range(3, height, _PIXEL_STEP)
            for column in range(3, width, _PIXEL_STEP)
        ]
        replies, times = [], []
        for v, u in places:
            values = robot.name, "", u + 0.5, v + 0.5
            times.append(robot.read_time_s())
            replies.append(ask(robot.client, GetPixelRequest, PixelReply, *values))
        times.append(robot.read_time_s())
    channels, (_, directions, _) = _channels(frame), _rays(frame)
    names = {one.number: one.name for one in _objects(frame)}
    names[0] = ""
    interior = _interior(channels["ids"])
    bounds = [one.bound_px for one in replies if one.bound_px is not None]
    moments = itertools.pairwise(times)
    for (row, column), one, (start_s, end_s) in zip(places, replies, moments, strict=True):
        if not start_s - _TICK_S <= one.time_s <= end_s + _TICK_S:
            raise CheckFailed(f"get_pixel at {one.time_s:g} s, from {start_s:g} to {end_s:g} s")
        name = f"get_pixel at {column} {row}"
        if one.theta_rad is None or one.azimuth_rad is None:
            require(one.theta_rad is one.azimuth_rad is one.range_m, True, name)
            continue
        sin = math.sin(one.theta_rad)
        direction = (
            sin * math.cos(one.azimuth_rad),
            sin * math.sin(one.azimuth_rad),
            math.cos(one.theta_rad),
        )
        error = math.dist(direction, directions[row, column])
        if error > 1e-3 or not 0.0 <= one.theta_rad <= math.pi:
            raise CheckFailed(f"{name}: the direction {direction}, {error:g} off the camera model")
        # Its rays pass through their own robot, which pictures and labels show: SPEC.md 9.3.
        require(one.object == robot.name, False, f"own robot, {name}")
        if interior[row, column] and names[int(channels["ids"][row, column])] != robot.name:
            require(one.object, names[int(channels["ids"][row, column])], f"object, {name}")
            expected_m = float(channels["range"][row, column])
            observed_m = math.inf if one.range_m is None else one.range_m
            if not math.isclose(observed_m, expected_m, rel_tol=1e-3, abs_tol=_POINT_TOLERANCE_M):
                raise CheckFailed(f"{name}: {observed_m:g} m, by labels {expected_m:g} m")
    if frame.error_bound_px is not None:
        # Pointwise bounds are parts of the one of the whole image, which one of them nearly has.
        is_right = 0.5 * frame.error_bound_px <= max(bounds) <= 1.01 * frame.error_bound_px
        require(is_right, True, f"largest bound_px {max(bounds):g} under {frame.error_bound_px:g}")


def check_landmark_lists(server: ServerUnderTest) -> None:
    """Landmarks are the same with and without a camera; their projections have a time."""
    with spawn_on_stream(server, *_near_beacon(server)) as robot:
        plain = ask(robot.client, GetLandmarksRequest, LandmarksReply, None, None)
        before_s = robot.read_time_s()
        seen = [
            ask(robot.client, GetLandmarksRequest, LandmarksReply, robot.name, "") for _ in range(3)
        ]
        after_s = robot.read_time_s()
        robot.turn_right(_TURN_RAD)
        low_s = robot.read_time_s()
        later = ask(robot.client, GetLandmarksRequest, LandmarksReply, robot.name, "")
        high_s = robot.read_time_s()
    require(plain.time_s, None, "time_s without a camera")
    for one in plain.landmarks:
        require((one.pixel, one.visible), (None, None), "pixel and visible without a camera")
        require(one.kind in ("beacon", "goal"), True, f"kind {one.kind}")
        colours = {one.lower_colour, one.upper_colour} - {"cyan", "magenta", "yellow"}
        require(colours, set(), f"colours of {one.name}")
    names = [one.name for one in plain.landmarks]
    require(len(set(names)) == len(names) and all(names), True, f"names of landmarks {names}")
    for reply, low, high in (*((one, before_s, after_s) for one in seen), (later, low_s, high_s)):
        if reply.time_s is None or not low - _TICK_S <= reply.time_s <= high + _TICK_S:
            raise CheckFailed(f"landmarks of {reply.time_s} s, requested at {low:g} to {high:g} s")
        for one, other in zip(plain.landmarks, reply.landmarks, strict=True):
            same = [
                (part.name, part.kind, part.x_m, part.y_m, part.width_m, part.depth_m)
                for part in (one, other)
            ]
            require(same[1], same[0], "a landmark with a camera")
            require(other.visible is not None, True, f"visible of {one.name}")


def _near_beacon(server: ServerUnderTest) -> tuple[tuple[float, float, float] | None, float]:
    """Place and heading of a robot that sees landmarks: the first start, turned."""
    with connect_stream(server) as client:
        poses = client.get_start_poses()
    if not poses:
        return None, 0.0
    return poses[0].location_m, poses[0].rotation_rad[2] + 0.3


def _get_labels(
    robot: StreamRobot,
    time_s: float,
    names: Sequence[str] = tuple(LABEL_CHANNELS),
    encoding: ChannelEncoding = ChannelEncoding.RAW,
) -> Frame:
    """Frame with channels on exact rays, exposed after a time; else the check is skipped."""
    variant = None
    for _ in range(6):
        try:
            frame = robot.client.get_frame(
                encoding=ImageEncoding.JPEG,
                robot=robot.name,
                channels=names,
                channel_encoding=encoding,
                variant=variant,
            )
        except CatoptraError as error:
            if type(error) is CatoptraError:
                raise CheckSkipped(f"no labels: {error}") from error
            raise
        if frame.labels is not None and frame.labels.is_displaced and variant is None:
            variant = FrameVariant(effects={"Misalignment": "never"})
        elif (frame.time_s or 0.0) >= time_s:
            return frame
    raise CheckFailed(f"five frames with labels have time_s below {time_s:g}")


def _channels(frame: Frame):
    if frame.labels is None:
        raise CheckFailed(f"frame {frame.sequence} has no labels")
    return frame.labels.truth.channels


def _objects(frame: Frame) -> tuple[LabelledObject, ...]:
    return () if frame.labels is None else frame.labels.truth.objects


def _rays(frame: Frame) -> tuple[Floats, Floats, Bools]:
    camera = frame.camera
    if not isinstance(camera, OmniCamera):
        raise CheckSkipped("the camera is not omnidirectional")
    columns, rows = (np.arange(size) + 0.5 for size in (camera.width_px, camera.height_px))
    origins, directions, valid = rays_from_pixel_grid(camera, columns, rows)
    return np.zeros_like(directions) if origins is None else origins, directions, valid


def _require_near(one: Floats, other: Floats, tolerance_m: float, name: str) -> None:
    errors = np.linalg.norm(one - other, axis=-1)
    if not float(np.quantile(errors, _MOST)) <= tolerance_m:
        raise CheckFailed(f"{name} are {np.quantile(errors, _MOST):.3f} m off")


def _require_normals(channels, mount: Pose, met: Bools) -> None:
    """Fail where the normals of neighbours on one facet are not across their distance."""
    points = channels["point"].astype(np.float64)
    normals = mount.rotate_directions(channels["normal"].astype(np.float64))
    same = (channels["ids"][:, 1:] == channels["ids"][:, :-1]) & met[:, 1:] & met[:, :-1]
    same &= (np.abs(normals[:, 1:] - normals[:, :-1]) < _NORMAL_TOLERANCE).all(axis=-1)
    steps = (points[:, 1:] - points[:, :-1])[same]
    lengths = np.linalg.norm(steps, axis=-1)
    across = abs((steps * normals[:, 1:][same]).sum(axis=-1))
    require(bool((across <= 0.02 * lengths + 1e-3).mean() > 0.9), True, "normals across facets")


def _require_rotation(one: LabelledObject) -> None:
    rotation = one.world_from_box.rotation
    error = np.abs(rotation @ rotation.T - np.eye(3)).max()
    require(error < 1e-6 and np.linalg.det(rotation) > 0.0, True, f"rotation of {one.name}")


def _interior(ids: npt.NDArray[np.uint16]) -> Bools:
    """Pixels whose eight neighbours show the same object."""
    padded = np.pad(ids, 1, constant_values=0)
    height, width = ids.shape
    around = [
        padded[row : row + height, column : column + width] == ids
        for row in range(3)
        for column in range(3)
    ]
    inside: Bools = np.all(around, axis=0) & (ids > 0)
    return inside


LABEL_CHECKS: tuple[Check, ...] = (
    check_from_function("stream_label_geometry", "stream", check_label_geometry),
    check_from_function("stream_label_objects", "stream", check_label_objects),
    check_from_function("stream_label_motion", "stream", check_label_motion),
    check_from_function("stream_moving_labels", "stream", check_moving_labels),
    check_from_function("stream_label_encodings", "stream", check_label_encodings),
    check_from_function("stream_pixels", "stream", check_pixels),
    check_from_function("stream_landmark_lists", "stream", check_landmark_lists),
)
