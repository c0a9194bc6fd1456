"""Checks of the live page's port: its documents, its WebSockets, and the robots that they drive.

The checks of the stream are played through WebSockets, too.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any
from urllib.parse import urlencode

import cv2
import msgpack
import numpy as np

from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.stream.replies import RobotState
from conformance.check import (
    Check,
    CheckFailed,
    CheckSkipped,
    ServerUnderTest,
    check_from_function,
    retry_once,
)
from conformance.image_panorama import project_directions
from conformance.page_session import get_document, on_page, open_page, request_page
from conformance.stream_checks import STREAM_CHECKS
from conformance.stream_session import connect_stream, require, spawn_on_stream
from conformance.stream_state_checks import find_robot, get_header

# Of a drive without `halt_after_s`, and of one with it, in seconds; a busy machine is late.
_HALT_S, _LONG_HALT_S, _LATE_S = 0.25, 0.6, 0.2
_DRIVE_PERIOD_S = 0.05
_WAIT_S = 3.0
# States that a check waits for, beside their times: the clock of a faulty server may stand.
_MAX_STATES = 20_000
_SPEED_RAD_S, _TURN_RAD_S = 1.0, 2.5
_MAX_REQUEST_BYTES = 16 * 1024
_TABLE_TOLERANCE_PX = 0.05
# Of points of labels, which are float32, to the obstacles of a plan; carpets are lower than these.
_PLAN_TOLERANCE_M, _PLAN_LOW_M = 0.03, 0.1
# Needs the control port.
_NOT_ON_PAGE = {"stream_camera_bound"}


@retry_once
def check_halt(server: ServerUnderTest) -> None:
    """A robot that a page drives halts 0.25 s after the last command, or when it says."""
    with spawn_on_stream(on_page(server)) as robot:
        for halt_after_s in (None, _LONG_HALT_S):
            expected_s = _HALT_S if halt_after_s is None else halt_after_s
            robot.client.drive(_SPEED_RAD_S, -_SPEED_RAD_S, halt_after_s=halt_after_s)
            driven_s = _drive_time(robot.client, robot.name)
            if not expected_s - _DRIVE_PERIOD_S <= driven_s <= expected_s + _LATE_S:
                raise CheckFailed(
                    f"a command with halt_after_s {halt_after_s} lasted {driven_s:.2f} s"
                )
        start_s = robot.clock()
        while robot.clock() - start_s < 2.0 * _HALT_S:
            robot.client.drive(_SPEED_RAD_S, -_SPEED_RAD_S)
            speeds = find_robot(robot.client, robot.name).wheel_speeds_rad_s
        require(speeds, (_SPEED_RAD_S, -_SPEED_RAD_S), "wheel speeds while a page drives")
        robot.wait_until_standing()


@retry_once
def check_end(server: ServerUnderTest) -> None:
    """A robot halts when the WebSocket that drives it ends; a page's own one is removed."""
    with spawn_on_stream(on_page(server)) as robot:
        owner = robot.client
        owner.share_control()
        with connect_stream(on_page(server)) as guest:
            _wait_for(owner, robot.name, lambda one: one.shares_control, "sharing")
            guest.drive(_SPEED_RAD_S, _SPEED_RAD_S, robot=robot.name, halt_after_s=60.0)
            _wait_for(owner, robot.name, lambda one: one.wheel_speeds_rad_s[0] > 0.0, "the drive")
        _wait_for(owner, robot.name, lambda one: one.wheel_speeds_rad_s == (0.0, 0.0), "the halt")
        name = robot.name
    with connect_stream(on_page(server)) as viewer:
        deadline_s = server.clock() + _WAIT_S
        while name in (names := {one.name for one in viewer.get_state().robots}):
            require(server.clock() < deadline_s, True, f"{name} of a closed page removed: {names}")


def check_messages(server: ServerUnderTest) -> None:
    """A message that is no request has an error, one too long or not UTF-8 ends its WebSocket."""
    with open_page(server) as page:
        for message in (b"\x81\xa4kind", "no json", "[]", json.dumps({"kind": "none", "id": 7})):
            page.send_message(message)
            fields = _receive_fields(server, page)
            require(fields["kind"], "error", f"reply to {message!r}")
            expected = 7 if isinstance(message, str) and "7" in message else 0
            require((fields["id"], bool(fields["reason"])), (expected, True), "id and reason")
        page.send_message(json.dumps({"kind": "get_status", "id": 8}))
        status = _receive_fields(server, page)
        require((status["kind"], status["id"], status["version"]), ("status", 8, 1), "reply")
    with open_page(server) as page:
        page.send_message(" " * (16 * _MAX_REQUEST_BYTES))
        require(page.receive_close(), 1009, "close code of a message that is too long")


def check_access(server: ServerUnderTest) -> None:
    """Other hosts and origins get 403, other methods 405, a request with a body 413."""
    host, port = server.addresses["page"]
    own = f"http://{host}:{port}"
    path = "/api/server.json"
    upgrade = {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
    }
    cases: list[tuple[str, str, dict[str, Any], int]] = [
        ("GET", "/", {}, 200),
        ("GET", path, {}, 200),
        ("GET", path, {"headers": {"Host": "example.org"}}, 403),
        ("GET", path, {"headers": {"Origin": "http://example.org"}}, 403),
        ("GET", path, {"headers": {"Origin": own}}, 200),
        ("GET", "/socket", {"headers": upgrade}, 403),
        ("GET", "/socket", {"headers": {**upgrade, "Origin": "http://example.org"}}, 403),
        ("POST", path, {}, 405),
        ("GET", path, {"data": b"body"}, 413),
        ("GET", "/api/camera_table.json?class=None&camera=None", {}, 404),
    ]
    for method, where, options, expected in cases:
        status, text = request_page(server, where, method, **options)
        require(status, expected, f"status of {method} {where} {options}")
        require(status != 403 or bool(text), True, "reason of a refusal")


def check_server_document(server: ServerUnderTest) -> None:
    """server.json names the classes, start poses and landmarks of the WebSocket's replies."""
    document = get_document(server, "/api/server.json")
    with spawn_on_stream(on_page(server)) as robot:
        status, frame = robot.client.get_status(), robot.get_frame()
        starts, landmarks = robot.client.get_start_poses(), robot.client.get_landmarks()
        one = find_robot(robot.client, robot.name)
    known = {key: document[key] for key in ("server", "world", "clock")}
    require(known, {key: getattr(status, key) for key in known}, "server.json")
    classes = {each["class_name"]: each for each in document["classes"]}
    require(set(classes), set(status.class_names), "classes of server.json")
    own = classes[one.class_name]
    cameras = {each["name"]: each for each in own["cameras"]}
    require(frame.camera_name in cameras, True, "cameras of server.json")
    camera = cameras[frame.camera_name]
    size = camera["width_px"], camera["height_px"]
    require(size, frame.rgb.shape[1::-1], "size of a camera in server.json")
    kind = "omni" if isinstance(frame.camera, OmniCamera) else "perspective"
    require(camera["kind"], kind, "kind of a camera in server.json")
    names = [each.name for each in frame.effects]
    require(camera["effects"], names, "effects in server.json")
    _require_drive(server, own)
    for name, replies in (("start_poses", starts), ("landmarks", landmarks)):
        listed = {each["name"]: each for each in document[name]}
        require(list(listed), [each.name for each in replies], f"{name} of server.json")
        for each in replies:
            for field in fields(each):
                value = listed[each.name].get(field.name)
                observed = tuple(value) if isinstance(value, list) else value
                require(observed, getattr(each, field.name), f"{field.name} of {each.name}")


def check_floor_plan(server: ServerUnderTest) -> None:
    """Points that a camera sees within a robot's height lie on the obstacles of the floor plan."""
    with spawn_on_stream(on_page(server)) as robot:
        class_name = find_robot(robot.client, robot.name).class_name
        frame = robot.client.get_frame(robot=robot.name, channels=("point", "ids", "classes"))
        starts = robot.client.get_start_poses()
    document = get_document(server, f"/api/floor_plan.json?{urlencode({'class': class_name})}")
    data = np.frombuffer(base64.b64decode(document["picture"]), np.uint8)
    picture = cv2.imdecode(data, cv2.IMREAD_COLOR_RGB)
    if picture is None:
        raise CheckFailed("the picture of the floor plan is no PNG")
    low, high = np.array(document["bounds"]).reshape(2, 2)
    height, width = picture.shape[:2]
    px_per_m = width / (high[0] - low[0])
    require(abs(height - (high[1] - low[1]) * px_per_m) < 2.0, True, "shape of the picture")
    for one in starts:
        place = np.array(one.location_m[:2])
        require(bool((place > low).all() and (place < high).all()), True, f"{one.name} on the plan")
    is_obstacle = (picture == document["colours"]["obstacle"]).all(axis=-1)
    if frame.labels is None or not is_obstacle.any():
        raise CheckSkipped("no labels or no obstacles")
    robots = {one.number for one in frame.labels.truth.objects if one.class_name == "robot"}
    channels = frame.labels.truth.channels
    points = channels["point"][~np.isin(channels["ids"], list(robots))].astype(np.float64)
    heights = -points[:, 2]
    seen = points[(heights > _PLAN_LOW_M) & (heights < document["height_m"] - _PLAN_TOLERANCE_M)]
    # The plan ends behind what a robot reaches.
    seen = seen[((seen[:, :2] > low) & (seen[:, :2] < high)).all(axis=1)]
    require(len(seen) > 20, True, "points seen within a robot's height")
    distances = cv2.distanceTransform(np.uint8(~is_obstacle), cv2.DIST_L2, 5) / px_per_m
    columns, rows = ((seen[:, :2] - low) * px_per_m).astype(np.intp).T
    misses = distances[rows.clip(0, height - 1), columns.clip(0, width - 1)]
    miss_m = float(np.quantile(misses, 0.95))
    if miss_m > _PLAN_TOLERANCE_M + 1.0 / px_per_m:
        raise CheckFailed(f"5 % of what is seen is over {miss_m:.3f} m from the plan's obstacles")


def check_camera_table(server: ServerUnderTest) -> None:
    """The camera table of the page gives the pixels of the camera model of a frame."""
    with spawn_on_stream(on_page(server)) as robot:
        frame, header = robot.get_frame(), get_header(robot)
        class_name = header.class_name
    if (
        not isinstance(frame.camera, OmniCamera)
        or not frame.camera.is_central
        or header.camera_model is None
    ):
        raise CheckSkipped("only central omnidirectional cameras have a table of directions")
    query = urlencode({"class": class_name, "camera": frame.camera_name})
    table = get_document(server, f"/api/camera_table.json?{query}")
    radii = np.array(table["radius_px"], dtype=np.float64)
    thetas = np.linspace(0.0, table["max_theta_rad"], len(radii))
    chosen = slice(64, len(radii) - 8, 251)
    matrix = np.array(table["azimuth_matrix"]).reshape(2, 2)
    for azimuth in (0.3, 1.9, 4.4):
        circle = np.array((math.cos(azimuth), math.sin(azimuth)))
        pixels = np.array(table["centre_px"]) + radii[chosen, None] * (matrix @ circle)
        sin = np.sin(thetas[chosen])
        directions = np.stack((sin * circle[0], sin * circle[1], np.cos(thetas[chosen])), axis=-1)
        expected, valid = project_directions(frame.camera, directions)
        errors = np.linalg.norm(pixels - expected, axis=-1)[valid]
        require(len(errors) > 3, True, "angles of the table within the camera model")
        if errors.max() > _TABLE_TOLERANCE_PX:
            raise CheckFailed(f"the camera table misses the camera model by {errors.max():.2f} px")
    size = table["width_px"], table["height_px"]
    require(size, (frame.camera.width_px, frame.camera.height_px), "size of the camera table")
    rim_rad = frame.camera.rim_rad
    require(abs(table["max_theta_rad"] - rim_rad) < 1e-3, True, f"max_theta_rad at {rim_rad:g}")
    require(0.0 <= table["min_theta_rad"] < 0.1 * rim_rad, True, "min_theta_rad of no cone")
    require(table["picture"], header.camera_model["Picture"], "picture of the camera table")


def _require_drive(server: ServerUnderTest, own: dict[str, Any]) -> None:
    """Fail where wheels of the stated size and speed do not turn the robot as it turns."""
    with spawn_on_stream(on_page(server)) as robot:
        # Less than half a revolution of the fastest robot between two states.
        fastest_rad_s = 2.0 * own["wheel_radius_m"] * own["max_speed_rad_s"]
        percent = min(50.0, 100.0 * _TURN_RAD_S * own["wheel_separation_m"] / fastest_rad_s)
        robot.client.drive(percent, -percent, normalized=True, halt_after_s=1.0)
        robot.client.get_readings()
        one = _wait_for(robot.client, robot.name, lambda it: it.wheel_speeds_rad_s[0] > 0, "drive")
        left = one.wheel_speeds_rad_s[0]
        (start_s, start), (end_s, end) = robot.read_state(), robot.read_state()
        for _ in range(_MAX_STATES):
            if end_s >= start_s + 0.4:
                break
            end_s, end = robot.read_state()
        robot.client.drive(0.0, 0.0)
        labels = robot.client.get_frame(robot=robot.name, channels=("ids",)).labels
    rate = start.motion_to(end).yaw_rad / (end_s - start_s)
    expected = 2.0 * left * own["wheel_radius_m"] / own["wheel_separation_m"]
    # Slip, and ticks at both ends.
    require(
        0.7 < rate / expected < 1.05, True, f"turn by {rate:.2f} rad/s, by wheels {expected:.2f}"
    )
    maximum = own["max_speed_rad_s"] * percent / 100.0
    require(abs(left - maximum) < 0.01 * maximum, True, f"{percent} % of the maximum: {left}")
    boxes = [] if labels is None else labels.truth.objects
    for box in boxes:
        if box.name == robot.name:
            sides = 2.0 * box.half_size_m[:2]
            is_near = np.allclose(sides, own["size_m"][:2], rtol=0.08)
            require(bool(is_near), True, f"size_m {own['size_m']} of a box of {sides}")


def _drive_time(client: StreamClient, name: str) -> float:
    """Simulation time until the wheels of a driven robot stand."""
    start_s = _wait_time(client, name, lambda one: one.wheel_speeds_rad_s[0] > 0.0)
    return _wait_time(client, name, lambda one: one.wheel_speeds_rad_s == (0.0, 0.0)) - start_s


def _wait_time(client: StreamClient, name: str, has: Callable[[RobotState], bool]) -> float:
    first_s = math.inf
    for _ in range(_MAX_STATES):
        state = client.get_state(name)
        first_s = min(first_s, state.time_s)
        if any(one.name == name and has(one) for one in state.robots):
            return state.time_s
        if state.time_s >= first_s + _WAIT_S:
            break
    raise CheckFailed("no start or end of a drive in time")


def _wait_for(
    client: StreamClient, name: str, has: Callable[[RobotState], bool], what: str
) -> RobotState:
    first_s = client.get_state(name).time_s
    for _ in range(_MAX_STATES):
        if has(one := find_robot(client, name)):
            return one
        if client.get_state(name).time_s >= first_s + _WAIT_S:
            break
    raise CheckFailed(f"no {what} in time")


def _receive_fields(server: ServerUnderTest, page: Any) -> dict[str, Any]:
    parts = page.receive(server.clock() + _WAIT_S)
    if parts is None:
        raise CheckFailed("no reply of a page")
    fields: dict[str, Any] = msgpack.unpackb(parts[0])
    return fields


def _through_page(check: Check) -> Check:
    """The check of the stream through WebSockets."""
    name = check.name.replace("stream_", "page_", 1)
    return replace(check, name=name, port="page", run=lambda server: check.run(on_page(server)))


DOCUMENT_CHECKS: tuple[Check, ...] = (
    check_from_function("page_server_document", "page", check_server_document),
    check_from_function("page_floor_plan", "page", check_floor_plan),
    check_from_function("page_camera_table", "page", check_camera_table),
)
PAGE_CHECKS: tuple[Check, ...] = (
    *DOCUMENT_CHECKS,
    check_from_function("page_halt", "page", check_halt),
    check_from_function("page_end", "page", check_end),
    check_from_function("page_messages", "page", check_messages, needs_robot=False),
    check_from_function("page_access", "page", check_access, needs_robot=False),
    *(_through_page(one) for one in STREAM_CHECKS if one.name not in _NOT_ON_PAGE),
)
