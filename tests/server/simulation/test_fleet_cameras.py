"""Environments, cameras of channels, and queries about what a camera sees."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import Landmark
from catoptra_server.frames.frame import (
    IMAGE_PORT,
    CameraChannel,
    Channel,
    FrameComposition,
    ImagePortChannel,
)
from catoptra_server.frames.multi_view import TileLayout
from catoptra_server.frames.plan.camera import CameraVariant, OmniCameraSpec, ReferenceKind
from catoptra_server.simulation.collision_index import CollisionIndex
from catoptra_server.simulation.fleet_cameras import FleetCameras, FleetEnvironment
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import (
    Mount,
    PerspectiveCameraDescription,
    PlanarPose,
    RobotDescription,
)
from catoptra_server.simulation.sensors import EmptyScene
from catoptra_server.world.scene_mesh import build_scene
from helpers.robots import (
    make_p2at,
    make_robot_at,
    make_walled_world,
)

WORLD = make_walled_world()
SCENE = build_scene(WORLD)


def make_robots(*names: str) -> list[Robot]:
    """Robots two metres apart along x."""
    return [
        make_robot_at(
            make_p2at(),
            PlanarPose(2.0 * i, 0.0, 0.0),
            name=name,
            seed=1,
            time_s=0.0,
        )
        for i, name in enumerate(names)
    ]


def make_environment(robots: Collection[Robot]) -> FleetEnvironment:
    index = CollisionIndex(SCENE, [make_p2at()])
    world = replace(WORLD, landmarks=(BEACON,))
    return FleetEnvironment(robots, world, SCENE, EmptyScene(), index)


def test_robot_when_it_senses_meets_the_others_and_not_itself() -> None:
    robots = make_robots("A", "B", "C")
    boxes = make_environment(robots).sense(robots[1]).robot_boxes
    assert [float(box.world_from_box.translation[0]) for box in boxes] == [0.0, 4.0]


def test_robot_when_removed_is_not_sensed_any_more() -> None:
    robots = make_robots("A", "B")
    environment = make_environment(robots)
    assert len(environment.sense(robots[0]).robot_boxes) == 1
    robots.pop()
    assert environment.sense(robots[0]).robot_boxes == ()


def test_robot_when_in_view_of_another_has_its_name() -> None:
    robots = make_robots("A", "B")
    things = make_environment(robots).name_objects(robots[0])
    distance_m, name = things.find_first(np.array([0.0, 0.0, -0.1]), np.array([1.0, 0.0, 0.0]))
    assert name == "B"
    assert 1.0 < distance_m < 2.0


BEACON = Landmark("b", "beacon", 2.0, 0.0, 0.1, 0.0, 0.2, 0.4, "cyan", "yellow")


def make_queries(*robots: Robot) -> FleetCameras:
    return FleetCameras(robots, [make_p2at()], make_environment(robots))


def make_robot(name: str, x_m: float) -> Robot:
    return make_robot_at(make_p2at(), PlanarPose(x_m, 0.0, 0.0), name=name, seed=1, time_s=0.0)


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


AHEAD = PerspectiveCameraDescription("Ahead", Mount(), 12, 10, 1.0, 0.3, 2.0)


class Cameras:
    """Cameras of robots that are a metre apart."""

    def __init__(
        self, description: RobotDescription | None = None, multi_view: TileLayout | None = None
    ) -> None:
        self.robots: dict[str, Robot] = {}
        self._description = description or make_p2at()
        robots = self.robots.values()
        self.cameras = FleetCameras(
            robots, [self._description], make_environment(robots), multi_view=multi_view
        )

    def spawn(self, *names: str) -> None:
        for name in names:
            pose = PlanarPose(float(len(self.robots)), 0.0, 0.0)
            robot = make_robot_at(self._description, pose, name=name, seed=1, time_s=0.0)
            self.robots[name] = robot
            self.cameras.assign_tiles(robot)

    def remove(self, name: str) -> None:
        self.cameras.release(self.robots.pop(name))

    def compose(self, channel: Channel = IMAGE_PORT) -> FrameComposition:
        composition = self.cameras.compose_frame(channel)
        assert composition is not None
        return composition


def test_image_port_without_a_robot_is_black_and_of_the_camera_s_size() -> None:
    composition = Cameras().compose()
    assert (composition.views, composition.layout.shape) == ((None,), (6, 8))
    no_camera = Cameras(make_p2at(omni_cameras=()))
    no_camera.spawn("R")
    composition = no_camera.compose()
    assert (composition.views, composition.layout.shape) == ((None,), (240, 320))


def test_image_port_shows_the_first_robot_and_then_the_next() -> None:
    cameras = Cameras()
    cameras.spawn("R", "S")
    assert cameras.compose().metadata.robot == "R"
    cameras.remove("R")
    composition = cameras.compose()
    assert composition.metadata.robot == "S"
    assert composition.metadata.world_from_robot.translation[0] == 1.0


@pytest.mark.parametrize("camera", ["", "OmniCam", "omnicam"])
@pytest.mark.parametrize(("robot", "expected"), [("S", "S"), ("", "R")])
def test_camera_of_a_channel_is_found_by_robot_and_name(
    robot: str, expected: str, camera: str
) -> None:
    cameras, channel = Cameras(), CameraChannel(robot, camera)
    cameras.spawn("R", "S")
    found = cameras.cameras.find(channel)
    assert found is not None
    assert (found[0].name, found[1].name) == (expected, "OmniCam")
    variant = CameraVariant(samples=2)
    one = CameraChannel(expected, "OmniCam", variant)
    assert cameras.cameras.resolve(replace(channel, variant=variant)) == one
    assert cameras.compose(channel).metadata.robot == expected


@pytest.mark.parametrize(
    "channel",
    [CameraChannel("Nobody", ""), CameraChannel("R", "Periscope"), CameraChannel("r", "")],
)
def test_channel_without_such_a_robot_or_camera_has_no_frame(channel: CameraChannel) -> None:
    cameras = Cameras()
    assert cameras.cameras.find(channel) is None
    cameras.spawn("R")
    assert cameras.cameras.find(channel) is None
    assert cameras.cameras.compose_frame(channel) is None
    assert cameras.cameras.resolve(channel) == channel


def test_names_of_a_removed_robot_stand_for_nothing_and_the_empty_one_for_the_next() -> None:
    cameras = Cameras()
    cameras.spawn("R", "S")
    cameras.remove("R")
    assert cameras.cameras.resolve(CameraChannel("R", "")) == CameraChannel("R", "")
    assert cameras.cameras.resolve(CameraChannel("", "")) == CameraChannel("S", "OmniCam")
    assert cameras.cameras.resolve(IMAGE_PORT) == IMAGE_PORT


def test_camera_sees_all_robots_but_its_own() -> None:
    cameras = Cameras()
    cameras.spawn("R", "S", "T")
    (view,) = cameras.compose(CameraChannel("S", "")).views
    assert view is not None
    x_m = sorted(one.world_from_object.translation[0] for one in view.camera_state.objects)
    assert x_m == [0.0, 2.0]


def test_tile_when_its_robot_is_removed_is_free_for_the_next() -> None:
    cameras = Cameras(multi_view=TileLayout(2, 1, 8, 6, 16, 6))
    cameras.spawn("R", "S", "T")
    assert [robot.tile_index for robot in cameras.robots.values()] == [0, 1, -1]
    cameras.remove("R")
    cameras.spawn("U")
    assert cameras.robots["U"].tile_index == 0
    assert cameras.compose(ImagePortChannel(0)).metadata.robot == "U"
    assert [view is not None for view in cameras.compose().views] == [True, True]


def test_variant_changes_the_view_of_its_channel_alone() -> None:
    cameras = Cameras()
    cameras.spawn("A")
    variant = CameraVariant(polygons=16, reference=ReferenceKind.CAMERA)
    plain = cameras.compose(CameraChannel("A", "")).views[0]
    composition = cameras.compose(CameraChannel("A", "", variant))
    (view,) = composition.views
    assert view is not None
    assert plain is not None
    assert composition.reference is not None
    assert isinstance(plain.camera, OmniCameraSpec)
    assert view.camera == variant.apply_to(plain.camera)
    assert composition.reference.camera == plain.camera
    assert composition.reference.camera_state is view.camera_state
    assert cameras.compose(CameraChannel("A", "")).reference is None


def test_variant_of_a_perspective_camera_is_refused() -> None:
    cameras = Cameras(make_p2at(omni_cameras=(), perspective_cameras=(AHEAD,)))
    cameras.spawn("A")
    with pytest.raises(DomainError, match="only omnidirectional cameras have variants"):
        cameras.compose(CameraChannel("A", "", CameraVariant()))
