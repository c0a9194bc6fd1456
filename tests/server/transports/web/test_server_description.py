"""The description of the server for the page."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import pytest

from catoptra_server.config.robot_file import read_robots
from catoptra_server.serve.stream.replies import build_server_info
from catoptra_server.serve.web.pages import describe_server
from helpers.configs import ROBOTS
from helpers.fake_simulation import SERVER_INFO
from helpers.worlds import make_test_world


def describe(name: str) -> Any:
    robots, _ = read_robots(ROBOTS / f"{name}.ini")
    info = build_server_info(robots, make_test_world(), clock="lockstep", plans={})
    return json.loads(json.dumps(describe_server(info), allow_nan=False))


def test_server_of_the_stream_is_described_with_starts_and_landmarks() -> None:
    description = json.loads(json.dumps(describe_server(SERVER_INFO), allow_nan=False))
    assert description["server"] == "Catoptra test"
    assert (description["world"], description["clock"]) == ("field", "lockstep")
    assert description["start_poses"] == [
        {"name": "Centre", "location_m": [1.0, 2.0, 3.0], "rotation_rad": [0.0, 0.0, 0.5]}
    ]
    (landmark,) = description["landmarks"]
    fields = {field.name for field in dataclasses.fields(SERVER_INFO.landmarks[0])}
    assert set(landmark) == fields | {"pixel", "visible"}
    assert description["polygons"] == [16, 64, 256, 1024, 4096]
    assert description["renderers"] == ["trace", "raster"]


def test_robot_with_all_sensors_has_its_cameras_and_range_sensors() -> None:
    (robot, *_) = describe("p2at_omni_full")["classes"]
    assert robot["wheel_radius_m"] > 0.0
    assert len(robot["size_m"]) == 3
    kinds = {camera["kind"] for camera in robot["cameras"]}
    assert kinds == {"omni", "perspective"}
    sensors = robot["sensors"]
    assert {sensor["type"] for sensor in sensors} == {"RangeScanner", "Sonar"}
    for sensor in sensors:
        assert -math.pi <= sensor["yaw_rad"] <= math.pi
        assert 0.0 < sensor["fov_rad"] <= 2.0 * math.pi
        assert sensor["max_range_m"] > 0.0
        assert math.hypot(sensor["x_m"], sensor["y_m"]) < 1.0


def test_effects_of_a_camera_are_those_of_the_robot_file() -> None:
    (robot, *_) = describe("p2at_omni_real")["classes"]
    (camera,) = [camera for camera in robot["cameras"] if camera["kind"] == "omni"]
    assert "SelfView" in camera["effects"]
    assert len(camera["effects"]) == len(set(camera["effects"])) > 5


@pytest.mark.parametrize(
    ("name", "expected"), [("p2at_omni", True), ("p2at_sphere", False), ("p2at_fisheye", False)]
)
def test_omnidirectional_cameras_state_whether_a_mesh_can_stand_for_their_mirror(
    name: str, expected: bool
) -> None:
    (robot, *_) = describe(name)["classes"]
    assert {camera["has_mesh"] for camera in robot["cameras"]} == {expected}


@pytest.mark.parametrize("name", ["p2at_omni", "p2at_omni_full"])
def test_class_names_are_those_that_can_be_spawned(name: str) -> None:
    robots, _ = read_robots(ROBOTS / f"{name}.ini")
    names = [robot["class_name"] for robot in describe(name)["classes"]]
    assert names == [robot.class_name for robot in robots]
