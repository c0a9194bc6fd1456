"""Checks of the stream's state: who is there, where robots start, how they move, what they report.

Every number is compared with a second statement of the server or with what was commanded.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Sequence

import numpy as np

from catoptra_client.frame_sources.stream.frame_decoding import pose_from_transform
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.replies import (
    CameraReply,
    FrameHeader,
    RobotState,
    SensorReports,
    StateReply,
)
from catoptra_protocol.stream.requests import (
    GetCameraRequest,
    GetFrameRequest,
    GetReadingsRequest,
    ImageEncoding,
    SpawnRequest,
    Transform,
)
from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.value_format import vector_from_text
from conformance.check import (
    Check,
    CheckFailed,
    CheckSkipped,
    ServerUnderTest,
    check_from_function,
    retry_once,
)
from conformance.control_readings import wrap
from conformance.stream_session import (
    StreamRobot,
    ask,
    connect_stream,
    planar_pose,
    require,
    spawn_on_stream,
)

_ROTATION_TOLERANCE = 1e-6
# A robot that settles on the floor, and one that was spawned a tick ago.
_PLACE_TOLERANCE_M, _PLACE_TOLERANCE_RAD = 0.02, 0.02
# Of poses at one moment, between two states a tick apart: less than half a tick of a fast robot.
_PATH_TOLERANCE_M, _PATH_TOLERANCE_RAD = 0.01, 0.02
# Decimals of a report.
_REPORT_TOLERANCE_M, _REPORT_TOLERANCE_RAD = 0.03, 0.03
# Slip and noise of an honest odometry.
_ODOMETRY_PART = 0.2
_DRIVE_S, _SPEED_PARTS, _FAST_RAD_S = 0.8, (0.75, 0.45), 5.4
_TICK_S = 0.05
# A chassis frame is less than this above the floor, where start poses are.
_MAX_RIDE_HEIGHT_M = 0.6
_MAX_POSES = 4
_WAIT_S = 2.0
# Of the clock against the wall clock.
_CLOCK_PART = 0.25


@retry_once
def check_status(server: ServerUnderTest) -> None:
    """Status counts clients and frames, and says whether there is a robot."""
    with connect_stream(server) as client:
        before = client.get_status()
        with connect_stream(server):
            during = client.get_status()
        with spawn_on_stream(server) as robot:
            owner = robot.client
            first = owner.get_status()
            num_frames = 3
            for _ in range(num_frames):
                robot.get_frame()
            second = owner.get_status()
            classes = {one.class_name for one in owner.get_state().robots}
            owner.reset()
            third = owner.get_status()
    require(during.num_clients, before.num_clients + 1, "num_clients with another client")
    require(before.num_clients >= 1, True, "num_clients >= 1 of a client")
    require((before.has_robot, second.has_robot), (False, True), "has_robot before and after spawn")
    require(third.has_robot, False, "has_robot after reset")
    require(before.sent_frames, 0, "sent_frames of a new client")
    require(second.sent_frames, first.sent_frames + num_frames, f"sent_frames after {num_frames}")
    require(first.sent_frames, 1, "sent_frames after one")
    require(classes <= set(before.class_names), True, f"class_names with {classes}")
    require(before.clock, "realtime", "clock")
    require(all((before.server, before.world)), True, "server and world of status")
    require(before.class_names, third.class_names, "class_names")


def check_start_poses(server: ServerUnderTest) -> None:
    """A robot that is spawned at a start pose stands there, with its heading."""
    with connect_stream(server) as client:
        poses = client.get_start_poses()
        if not poses:
            raise CheckSkipped("the server has no start poses")
        for start in poses[:_MAX_POSES]:
            values = server.robot_class, None, None, start.name
            reply = ask(client, SpawnRequest, SensorReports, *values)
            one = find_robot(client, reply.robot)
            place, (_, _, yaw_rad) = pose_from_transform(one.world_from_start), start.rotation_rad
            expected = reply.moved_to or start.location_m
            x, y, z = (float(number) for number in place.translation)
            error_m = math.dist((x, y), expected[:2])
            error_rad = abs(wrap(planar_pose(place).yaw_rad - yaw_rad))
            if error_m > _PLACE_TOLERANCE_M or error_rad > _PLACE_TOLERANCE_RAD:
                raise CheckFailed(
                    f"start pose {start.name} is at {expected}, yaw {yaw_rad:g}: the robot starts "
                    f"at {planar_pose(place)}"
                )
            require(abs(z - expected[2]) < _MAX_RIDE_HEIGHT_M, True, f"height at {start.name}")
            require_upright(place, f"world_from_start at {start.name}")
            client.reset()


def check_spawn(server: ServerUnderTest) -> None:
    """Two robots spawned at one place have names and places of their own, and reports."""
    with spawn_on_stream(server) as robot, connect_stream(server) as client:
        first = find_robot(robot.client, robot.name)
        x, y, _ = first.world_from_robot.position_m
        yaw_rad = 0.4
        values = server.robot_class, robot.name, (x, y, 0.0), None, (0.0, 0.0, yaw_rad)
        reply = ask(client, SpawnRequest, SensorReports, *values)
        second = find_robot(client, reply.robot)
        readings = ask(client, GetReadingsRequest, SensorReports)
        known = client.get_state().robots
    require(reply.robot != robot.name, True, "another name for the second robot")
    start = pose_from_transform(second.world_from_start)
    require_upright(start, "world_from_start")
    turn_rad = abs(wrap(planar_pose(start).yaw_rad - yaw_rad))
    require(turn_rad < _PLACE_TOLERANCE_RAD, True, f"yaw {yaw_rad} rad of a start at {start}")
    place = second.world_from_start.position_m
    if math.dist(place[:2], (x, y)) > _PLACE_TOLERANCE_M:
        if reply.moved_to is None:
            raise CheckFailed(f"moved_to is nil, but the robot at {(x, y)} starts at {place}")
        require(
            math.dist(place[:2], reply.moved_to[:2]) < _PLACE_TOLERANCE_M,
            True,
            f"moved_to {reply.moved_to} of the robot that starts at {place}",
        )
        height_m = abs(place[2] - reply.moved_to[2])
        require(height_m < _PLACE_TOLERANCE_M, True, "height of moved_to")
    require([one.name for one in known[-2:]], [robot.name, reply.robot], "robots in order")
    require(_sources(reply.reports), _sources(readings.reports), "sensors after spawn")
    require(readings.moved_to is None and not readings.robot, True, "no robot in readings")


@retry_once
def check_path(server: ServerUnderTest) -> None:
    """Poses of states, frames, landmarks and readings of a driving robot are on one path."""
    with spawn_on_stream(server) as robot:
        robot.wait_until_standing()
        # A hundredth of the maximum, which may be slow.
        robot.client.drive(1.0, 1.0, normalized=True, robot=robot.name)
        maximum = 100.0 * find_robot(robot.client, robot.name).wheel_speeds_rad_s[0]
        robot.client.drive(0.0, 0.0)
        robot.wait_until_standing()
        start = find_robot(robot.client, robot.name)
        left, right = speeds = tuple(min(_FAST_RAD_S, maximum) * part for part in _SPEED_PARTS)
        robot.client.drive(left, right, halt_after_s=10.0 * _DRIVE_S)
        end_s = robot.clock() + _DRIVE_S
        states: list[tuple[float, float, StateReply]] = []
        frames: list[tuple[float, float, FrameHeader]] = []
        while robot.clock() < end_s:
            states.append(_timed(robot, lambda: robot.client.get_state(robot.name)))
            if len(states) % 8 == 0:
                frames.append(_timed(robot, lambda: get_header(robot)))
        robot.client.drive(0.0, 0.0)
        robot.wait_until_standing()
        after = robot.client.get_state(robot.name)
    path = [(state, own_robot(state, robot.name)) for _, _, state in states]
    later = [one for state, one in path if state.time_s > states[0][2].time_s + _TICK_S]
    for one in later:
        require(one.wheel_speeds_rad_s, speeds, "wheel_speeds_rad_s after DRIVE")
    require(own_robot(after, robot.name).wheel_speeds_rad_s, (0.0, 0.0), "speeds after a halt")
    for _, one in path:
        require_close(one.world_from_start, start.world_from_robot, "world_from_start")
        require_upright(pose_from_transform(one.world_from_robot), "world_from_robot of the state")
    _require_forward(path)
    for arrived, sent, state in states:
        _require_clock(states[0], (arrived, sent, state), "the state")
    for _, _, header in frames:
        place = pose_from_transform(header.world_from_robot)
        _require_on_path(path, header.time_s, place, f"frame {header.sequence}")
        require_upright(place, f"frame {header.sequence}")
    _require_ages(states, frames)
    _require_readings(path, start)


def _timed(robot: StreamRobot, ask_server: Callable[[], object]) -> tuple[float, float, object]:
    sent_s = robot.clock()
    reply = ask_server()
    return sent_s, robot.clock(), reply


def _require_clock(first, later, name: str) -> None:
    """Fail where the time of a message does not advance as the clock does."""
    elapsed_s = later[1] - first[1]
    difference_s = later[2].time_s - first[2].time_s - elapsed_s
    if abs(difference_s) > _CLOCK_PART * _DRIVE_S:
        raise CheckFailed(f"time_s of {name} differs by {difference_s:g} s from the wall clock")


def _require_ages(states, frames) -> None:
    """Fail where a frame was exposed and sent at other times than between request and arrival."""
    offset_s = float(np.median([state.time_s - arrived_s for _, arrived_s, state in states]))
    # The first may repeat a picture of another client, too.
    last_stage_ms = frames[0][2].stage_ms
    for sent_s, arrived_s, header in frames:
        sending_s = header.time_s + header.age_s
        # A frame shows the world a tick before its exposure.
        if not sent_s - 2.0 * _TICK_S < sending_s - offset_s < arrived_s + _TICK_S:
            raise CheckFailed(
                f"frame {header.sequence} of {header.time_s:g} s is {header.age_s:g} s old: it was "
                f"requested at {sent_s + offset_s:.3f} s and arrived at {arrived_s + offset_s:.3f}"
            )
        drawing_s = sum(header.stage_ms.values()) / 1000.0
        if header.stage_ms == last_stage_ms:
            continue  # of a picture that is repeated
        last_stage_ms = header.stage_ms
        if not 0.0 < drawing_s <= header.age_s or min(header.stage_ms.values()) < 0.0:
            raise CheckFailed(f"a frame {header.age_s:g} s old has the stages {header.stage_ms}")


def _require_forward(path: Sequence[tuple[StateReply, RobotState]]) -> None:
    """Fail where a robot whose left wheels are faster does not move ahead and to the right."""
    start, end = (
        planar_pose(pose_from_transform(one.world_from_robot)) for _, one in (path[0], path[-1])
    )
    motion = start.motion_to(end)
    if motion.x_m < 2.0 * abs(motion.y_m) or motion.yaw_rad < 0.02 or motion.x_m < 0.05:
        raise CheckFailed(f"faster wheels on the left moved the robot by {motion}")


def _require_on_path(path, time_s: float, pose: Pose, name: str) -> None:
    times = [state.time_s for state, _ in path]
    index = int(np.searchsorted(times, time_s))
    around = [path[i] for i in (index - 1, index) if 0 <= i < len(path)]
    if len(around) < 2:
        if not times[0] - 1.0 <= time_s <= times[-1] + 1.0:
            raise CheckFailed(f"{name} is of {time_s:g} s, the states from {times[0]:g} s on")
        return
    poses = [pose_from_transform(one.world_from_robot) for _, one in around]
    low, high = (state.time_s for state, _ in around)
    part = (time_s - low) / (high - low) if high > low else 0.0
    place = (1.0 - part) * poses[0].translation + part * poses[1].translation
    yaws = [planar_pose(one).yaw_rad for one in poses]
    yaw = yaws[0] + part * wrap(yaws[1] - yaws[0])
    error_m = float(np.linalg.norm(place - pose.translation))
    error_rad = abs(wrap(planar_pose(pose).yaw_rad - yaw))
    if error_m > _PATH_TOLERANCE_M or error_rad > _PATH_TOLERANCE_RAD:
        raise CheckFailed(
            f"{name} of {time_s:g} s is {error_m:.3f} m and {error_rad:.3f} rad off the path of "
            "the states"
        )


def _require_readings(path, start: RobotState) -> None:
    """Fail where GroundTruth and odometry of the state are not those of the robot's path."""
    start_yaw = planar_pose(pose_from_transform(start.world_from_robot))
    num_reports = 0
    for state, one in path:
        for line in state.reports:
            message = parse_message(line)
            kind, time = message.get("Type"), message.get("Time")
            location, angles = message.get("Location"), message.get("Orientation")
            if kind == "GroundTruth" and location and angles and time:
                _require_reading(path, float(time), vector_from_text(location), angles)
                num_reports += 1
            if kind == "Odometry" and (pose := message.get("Pose")):
                x, y, _ = vector_from_text(pose)
                place = planar_pose(pose_from_transform(one.world_from_robot))
                motion = start_yaw.motion_to(place)
                # A report may be an interval old.
                lag_m = 0.2
                if math.dist((x, y), (motion.x_m, motion.y_m)) > _ODOMETRY_PART + lag_m:
                    raise CheckFailed(f"odometry {pose} after a motion by {motion}")


def _require_reading(path, time_s: float, location, angles: str) -> None:
    first = path[0][0].time_s
    if time_s < first:
        return
    nearest = min(path, key=lambda one: abs(one[0].time_s - time_s))
    if abs(nearest[0].time_s - time_s) > _TICK_S:
        if time_s < path[-1][0].time_s:
            return  # between two states of a busy server, whose pose then is not known
        raise CheckFailed(f"a reading of {time_s:g} s in a state of {path[-1][0].time_s:g} s")
    place = pose_from_transform(nearest[1].world_from_robot)
    yaw_rad = vector_from_text(angles)[2]
    error_m = float(np.linalg.norm(place.translation - np.array(location)))
    if error_m > 2 * _REPORT_TOLERANCE_M or (
        abs(wrap(planar_pose(place).yaw_rad - yaw_rad)) > 2 * _REPORT_TOLERANCE_RAD
    ):
        raise CheckFailed(f"GroundTruth {location} {angles} at {planar_pose(place)}")


def check_reports(server: ServerUnderTest) -> None:
    """The readings of a robot are the same in its state and by get_readings."""
    with spawn_on_stream(server) as robot:
        robot.wait_until_standing()
        for _ in range(5):
            state = robot.client.get_state(robot.name)
            readings = ask(robot.client, GetReadingsRequest, SensorReports).reports
            again = robot.client.get_state(robot.name)
            require(state.robot, robot.name, "robot of a state")
            missing = set(readings) - {*state.reports, *again.reports}
            if not missing:
                break
        default = robot.client.get_state()
        nobody = robot.client.get_state(robot.name + "x")
    require(missing, set(), "readings that the state lacks")
    require(any(line.startswith("STA") for line in state.reports), True, "a status in the state")
    require(_sources(state.reports), _sources(again.reports), "sensors")
    require(default.robot in {one.name for one in default.robots}, True, "robot of the image port")
    require((nobody.robot, nobody.reports, nobody.notes), ("", (), ()), "state of no robot")


def check_notes(server: ServerUnderTest) -> None:
    """A state has the newest note of each name, and whether the robot is shared."""
    with spawn_on_stream(server) as robot:
        client = robot.client
        states = [client.get_state(robot.name)]
        for name, number in (("first", 1), ("second", 2), ("first", 3)):
            client.publish(name, {"text": str(number)})
            states.append(client.get_state(robot.name))
        client.share_control(True)
        shared = _wait_for_sharing(robot, True)
        client.share_control(False)
        private = _wait_for_sharing(robot, False)
    require((shared, private), (True, False), "shares_control")
    require(states[0].notes, (), "notes before the first one")
    notes = {one.name: json.loads(one.text) for one in states[-1].notes}
    require(notes, {"first": {"text": "3"}, "second": {"text": "2"}}, "notes")
    newest = {0: "first", 1: "second", 2: "first"}
    for index, name in newest.items():
        time_s = next(one.time_s for one in states[index + 1].notes if one.name == name)
        low, high = states[index].time_s, states[index + 1].time_s
        if not low - _TICK_S <= time_s <= high + _TICK_S:
            raise CheckFailed(f"a note published from {low:g} to {high:g} s is of {time_s:g} s")


def check_cameras(server: ServerUnderTest) -> None:
    """get_camera, frames and the state name one camera of one class, with one model and mount."""
    with spawn_on_stream(server) as robot:
        one = find_robot(robot.client, robot.name)
        header = get_header(robot)
        reply = ask(robot.client, GetCameraRequest, CameraReply, header.camera)
        first = ask(robot.client, GetCameraRequest, CameraReply, "")
    require((header.robot, one.name), (robot.name, robot.name), "robot of a frame")
    require(header.class_name, one.class_name, "class_name of a frame")
    require((reply.class_name, reply.camera), (one.class_name, header.camera), "get_camera")
    require(bool(header.camera and header.class_name), True, "camera and class of a frame")
    require((first.camera, first.class_name), (reply.camera, reply.class_name), "first camera")
    require(reply.camera_model, header.camera_model, "camera_model of get_camera")
    size = tuple(int(float(reply.camera_model[name])) for name in ("Width", "Height"))
    require(size, (header.width_px, header.height_px), "Width and Height of the camera model")
    if header.robot_from_mirror is None:
        raise CheckFailed("a frame of one camera has no robot_from_mirror")
    require_close(reply.robot_from_mirror, header.robot_from_mirror, "robot_from_mirror")
    require_rigid(reply.robot_from_mirror, "robot_from_mirror")
    require(reply.plan in (header.plan, None), True, "plan of get_camera, as of a frame")


@retry_once
def check_counts(server: ServerUnderTest) -> None:
    """Frames are numbered in turn; those of others are missed, none is dropped."""
    others = 0, 4, 3, 0
    with spawn_on_stream(server) as robot, connect_stream(server) as viewer:
        # The count may restart, since the robot before had the same name.
        headers = [get_header(robot) for _ in range(3)][-1:]
        first = get_header_of(viewer, robot.name)
        for num_others in others:
            for _ in range(num_others):
                get_header_of(viewer, robot.name)
            headers.append(get_header(robot))
        error = _find_error(robot, "NoSuchCamera")
    require(headers[0].sequence >= 1, True, "sequence from 1")
    for before, after in itertools.pairwise(headers):
        missed = after.missed_frames - before.missed_frames
        step = after.sequence - before.sequence
        require(step, 1 + missed, "step of sequence, which is 1 + the step of missed_frames")
        require(after.dropped_frames, 0, "dropped_frames of a client that reads all")
    missed = headers[-1].missed_frames - headers[0].missed_frames
    # The first frame of the viewer, and the last one, may be frames of the other client; a server
    # may draw the next one ahead.
    is_right = sum(max(0, number - 2) for number in others) <= missed <= 2 * sum(others)
    require(is_right, True, f"{missed} missed_frames after {sum(others)} frames of another client")
    require(first.missed_frames, 0, "missed_frames of a new client")
    require("nosuchcamera" in error.lower(), True, f"name of the missing camera in {error!r}")


def _find_error(robot: StreamRobot, camera: str) -> str:
    try:
        ask(robot.client, GetCameraRequest, CameraReply, camera)
    except CatoptraError as error:
        return str(error)
    raise CheckFailed(f"get_camera has no error for the camera {camera}")


def _wait_for_sharing(robot: StreamRobot, shared: bool) -> bool:
    deadline_s = robot.clock() + _WAIT_S
    while robot.clock() < deadline_s:
        if find_robot(robot.client, robot.name).shares_control == shared:
            return shared
    return not shared


def _sources(reports: Sequence[str]) -> set[tuple[str, str | None, str | None]]:
    """Sensors of reports: word, type and name."""
    messages = [parse_message(line) for line in reports]
    return {(one.word, one.get("Type"), one.get("Name")) for one in messages}


def find_robot(client: StreamClient, name: str) -> RobotState:
    """A robot in the state."""
    return own_robot(client.get_state(name), name)


def own_robot(state: StateReply, name: str) -> RobotState:
    """The robot of a name in a state."""
    for one in state.robots:
        if one.name == name:
            return one
    raise CheckFailed(f"the state does not list the robot {name}")


def get_header(robot: StreamRobot) -> FrameHeader:
    """Header of a new frame of the robot's first camera."""
    return get_header_of(robot.client, robot.name)


def get_header_of(client: StreamClient, robot: str) -> FrameHeader:
    """Header of a new frame of a robot's first camera."""
    return ask(client, GetFrameRequest, FrameHeader, robot, "", ImageEncoding.JPEG)


def require_rigid(transform: Transform, name: str) -> None:
    """Fail where a rotation is none."""
    rotation = np.array(transform.rotation).reshape(3, 3)
    error = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if error > _ROTATION_TOLERANCE or np.linalg.det(rotation) < 0.0:
        raise CheckFailed(f"the rotation of {name} is {transform.rotation}")


def require_upright(pose: Pose, name: str) -> None:
    """Fail where a robot on level floor is not upright, or not above the floor."""
    rotation = pose.rotation
    error = np.abs(rotation @ rotation.T - np.eye(3)).max()
    is_upright = abs(rotation[2, 2] - 1.0) < 0.01 and np.linalg.det(rotation) > 0.0
    if error > _ROTATION_TOLERANCE or not is_upright:
        raise CheckFailed(f"{name} has the rotation {rotation.tolist()}")
    if not -_MAX_RIDE_HEIGHT_M < pose.translation[2] <= 0.0:
        raise CheckFailed(f"{name} is at z = {pose.translation[2]:g}")


def require_close(one: Transform, other: Transform, name: str) -> None:
    """Fail where two transforms of a standing thing differ."""
    numbers = (*one.position_m, *one.rotation), (*other.position_m, *other.rotation)
    if not np.allclose(*numbers, rtol=0.0, atol=1e-3):
        raise CheckFailed(f"{name} is {one}, and elsewhere {other}")


STATE_CHECKS: tuple[Check, ...] = (
    check_from_function("stream_clients", "stream", check_status),
    check_from_function("stream_start_poses", "stream", check_start_poses),
    check_from_function("stream_spawn", "stream", check_spawn),
    check_from_function("stream_path", "stream", check_path),
    check_from_function("stream_reports", "stream", check_reports),
    check_from_function("stream_notes", "stream", check_notes),
    check_from_function("stream_cameras", "stream", check_cameras),
    check_from_function("stream_counts", "stream", check_counts),
)
