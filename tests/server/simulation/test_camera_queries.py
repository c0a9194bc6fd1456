"""Queries of a channel: the camera that it names, at the robot's present pose."""

from __future__ import annotations

from catoptra_protocol.landmarks import Landmark
from catoptra_server.frames.frame import CameraChannel
from catoptra_server.simulation.cameras import CameraQueries, FleetCameras, FleetEnvironment
from catoptra_server.simulation.collision_index import CollisionIndex
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.simulation.sensors.sensor import EmptyScene
from catoptra_server.world.scene_mesh import build_scene
from helpers.robots import make_p2at, make_walled_world

BEACON = Landmark("b", "beacon", 2.0, 0.0, 0.1, 0.0, 0.2, 0.4, "cyan", "yellow")


def make_queries(*robots: Robot) -> CameraQueries:
    world = make_walled_world()
    scene, classes = build_scene(world), [make_p2at()]
    index = CollisionIndex(scene, classes)
    environment = FleetEnvironment(robots, world, scene, EmptyScene(), index)
    cameras = FleetCameras(robots, classes, None)
    return CameraQueries(cameras, environment, (BEACON,), lambda camera: None)


def make_robot(name: str, x_m: float) -> Robot:
    return Robot(make_p2at(), PlanarPose(x_m, 0.0, 0.0), name=name, seed=1, time_s=0.0)


def test_queries_when_robot_or_camera_is_missing_have_no_result() -> None:
    queries = make_queries(make_robot("R", 0.0))
    for channel in (CameraChannel("Other", ""), CameraChannel("R", "Other")):
        assert queries.compute_landmark_visibility(channel) is None
        assert queries.look_through_pixel(channel, (1.0, 1.0)) is None


def test_queries_when_the_camera_is_there_see_landmarks_and_robots() -> None:
    queries = make_queries(make_robot("R", 0.0), make_robot("Near", 1.0))
    landmarks = queries.compute_landmark_visibility(CameraChannel("R", ""))
    assert landmarks is not None
    assert len(landmarks) == 1
    # Of all pixels some show the other robot, none the robot itself.
    names = {
        view.object_name
        for u in range(32)
        for v in range(24)
        if (view := queries.look_through_pixel(CameraChannel("R", ""), (0.25 * u, 0.25 * v)))
    }
    assert "Near" in names
    assert "R" not in names
