"""Class, place and name of INIT; meshes of robots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.usarsim.commands import Drive, Init
from catoptra_protocol.usarsim.reports import StartPose
from catoptra_server.effects import EffectMode, EffectSetting, EffectSettings
from catoptra_server.effects.medium.vignetting import Vignetting
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.simulation.drive import RobotBody
from catoptra_server.simulation.fleet_cameras import RobotMeshes
from catoptra_server.simulation.ground import NoStandError
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_bodies import build_ego_mesh
from catoptra_server.simulation.robot_description import PlanarPose, RobotDescription
from catoptra_server.simulation.spawning import (
    SpawnError,
    find_class,
    place_robot,
    unique_name,
)
from catoptra_server.world.world_description import Twist
from helpers.robots import make_ground, make_p2at, make_robot_at, make_walled_world, stand

CLASSES = (make_p2at(class_name="USARBot.P2AT"), make_p2at(class_name="USARBot.P2DX"))
STARTS = make_walled_world().starts


@pytest.mark.parametrize(("name", "index"), [("P2DX", 1), ("usarbot.p2at", 0)])
def test_class_when_named_is_found_in_any_case(name: str, index: int) -> None:
    assert find_class(CLASSES, name) is CLASSES[index]


@pytest.mark.parametrize("name", ["P2", ""])
def test_class_when_unknown_is_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(SpawnError, match=r"no class '.*': this server has USARBot.P2AT, USARBot"):
        find_class(CLASSES, name)


class FakePlaces:
    """Places of robots, free from a distance to (3, 4)."""

    def __init__(self, radius_m: float = 0.0) -> None:
        self.radius_m = radius_m
        self.tested: list[tuple[RobotDescription, PlanarPose, float]] = []

    def place(
        self,
        description: RobotDescription,
        pose: PlanarPose,
        z_m: float = 0.0,
        *,
        clearance_m: float = 0.0,
        robots: Iterable[Robot] = (),
    ) -> RobotBody:
        self.tested.append((description, pose, clearance_m))
        if math.hypot(pose.x_m - 3.0, pose.y_m - 4.0) < self.radius_m:
            raise NoStandError("it is not free")
        return stand(description, pose)

    def may_stand(
        self,
        description: RobotDescription,
        places: Floats,
        yaw_rad: float,
        z_m: float,
        clearance_m: float,
        robots: Iterable[Robot],
    ) -> Bools:
        """Of all places those that have room, and one that has not."""
        away_m = np.hypot(*(places - (3.0, 4.0)).T)
        may_stand: Bools = away_m >= self.radius_m
        may_stand[0] = True
        return may_stand


def spawn_pose(init: Init, starts: Sequence[StartPose]) -> PlanarPose:
    """Pose of a robot where all places are free."""
    return place_robot(init, CLASSES, starts, FakePlaces(), ())[1].pose


def test_pose_at_a_named_start_is_the_start_s() -> None:
    assert spawn_pose(Init("P2AT", start="aside"), STARTS) == PlanarPose(1.0, -2.0, 1.5)


def test_start_when_unknown_is_refused_with_the_known_ones() -> None:
    with pytest.raises(SpawnError, match="no start 'nowhere': this world has Centre, Aside"):
        spawn_pose(Init("P2AT", start="nowhere"), STARTS)
    with pytest.raises(SpawnError, match="'asid': this world has Centre, Aside; did you mean Asid"):
        spawn_pose(Init("P2AT", start="asid"), STARTS)
    with pytest.raises(SpawnError, match="needs a start or a Location: this world has none"):
        spawn_pose(Init("P2AT"), ())
    with pytest.raises(SpawnError, match="needs a start or a Location: this world has Edge"):
        spawn_pose(Init("P2AT"), (replace(STARTS[0], name="Edge"),))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("value", [1.1e5, -1e19, 1e308, math.inf, math.nan])
def test_location_out_of_limits_is_refused_in_words(axis: int, value: float) -> None:
    location = tuple(value if i == axis else 0.0 for i in range(3))
    with pytest.raises(SpawnError, match=r"Location .* is out of limits: each number is at most"):
        spawn_pose(Init("P2AT", location_m=(location[0], location[1], location[2])), STARTS)


@pytest.mark.parametrize("value", [1e7, -1e300, math.inf, math.nan])
def test_rotation_out_of_limits_is_refused_in_words(value: float) -> None:
    init = Init("P2AT", location_m=(0.0, 0.0, 0.0), rotation_rad=(0.0, 0.0, value))
    with pytest.raises(SpawnError, match=r"Rotation .* is out of limits"):
        spawn_pose(init, STARTS)


def find_free_pose(places: FakePlaces) -> PlanarPose:
    """Pose of a robot that is requested at (3, 4)."""
    init = Init("P2AT", location_m=(3.0, 4.0, 0.0), rotation_rad=(0.0, 0.0, 0.7))
    description, body, is_moved = place_robot(init, CLASSES, (), places, ())
    assert description is CLASSES[0]
    assert is_moved == (body.pose != REQUESTED)
    return body.pose


REQUESTED = PlanarPose(3.0, 4.0, 0.7)


def test_free_pose_is_kept_to_the_last_bit_after_one_test() -> None:
    places = FakePlaces()
    assert find_free_pose(places) == REQUESTED
    assert len(places.tested) == 1


@pytest.mark.parametrize("radius_m", [0.05, 0.3, 1.0, 1.95, 2.0, 2.1, 5.0, 8.0])
def test_pose_that_is_not_free_moves_to_the_nearest_place(radius_m: float) -> None:
    pose = find_free_pose(FakePlaces(radius_m - 1e-9))
    moved_m = math.hypot(pose.x_m - 3.0, pose.y_m - 4.0)
    # The grid has steps of 0.1 m, and of 0.4 m beyond 2 m.
    step_m, end_m = (0.1, 2.0) if radius_m <= 2.0 else (0.4, 8.0)
    assert radius_m - 1e-9 <= moved_m <= min(radius_m + step_m, end_m + 1e-9)
    assert pose.yaw_rad == REQUESTED.yaw_rad
    assert pose == find_free_pose(FakePlaces(radius_m - 1e-9))


def test_pose_without_a_free_place_within_8_m_is_refused() -> None:
    with pytest.raises(SpawnError, match="no free place within 8 m of 3,4, where it is not free"):
        find_free_pose(FakePlaces(8.0 + 0.01))


def test_places_have_clearance_that_the_requested_one_need_not_have() -> None:
    places = FakePlaces(0.5)
    find_free_pose(places)
    clearances = [clearance_m for _, _, clearance_m in places.tested]
    assert clearances[0] == 0.0
    assert min(clearances[1:]) > 0.01


def test_name_in_use_gets_the_first_free_number() -> None:
    assert unique_name("R", {"R", "R2", "R4"}) == "R3"
    assert unique_name("R", set()) == "R"


def robot(x_m: float) -> Robot:
    place = PlanarPose(x_m, 0.5, 1.0)
    return make_robot_at(make_p2at(), place, name=f"R{x_m}", seed=0, time_s=0.0)


def test_dynamic_objects_have_the_poses_of_the_robots():
    robots = [robot(0.0), robot(2.0)]
    bodies = RobotMeshes([make_p2at()]).dynamic_objects(robots)
    for body, standing in zip(bodies, robots, strict=True):
        np.testing.assert_array_equal(
            body.world_from_object.translation, standing.world_from_robot.translation
        )


def test_object_of_a_robot_is_the_same_until_its_pose_or_motion_changes() -> None:
    meshes, one = RobotMeshes([make_p2at()]), robot(0.0)
    (standing,) = meshes.dynamic_objects([one])
    assert meshes.dynamic_objects([robot(2.0), one])[1] is standing
    one.twist = Twist((1.0, 0.0, 0.0))
    (moving,) = meshes.dynamic_objects([one])
    assert moving.twist is one.twist
    one.drive_wheels(Drive(1.0, 1.0), 0.0)
    one.step(0.02, 0.02, make_ground().move)
    (moved,) = meshes.dynamic_objects([one])
    assert moved.world_from_object is one.world_from_robot


def test_robots_of_a_class_share_one_mesh_for_ever():
    appearance = RobotMeshes([make_p2at()])
    first, second = appearance.dynamic_objects([robot(0.0), robot(1.0)])
    (later,) = appearance.dynamic_objects([robot(3.0)])
    assert first.mesh is second.mesh is later.mesh


@pytest.mark.parametrize("mode", list(EffectMode))
def test_ego_body_when_configured_has_one_mesh_a_class(mode: EffectMode) -> None:
    omni = make_p2at().omni_camera
    assert omni is not None
    effect_settings = EffectSettings((EffectSetting(SelfView(), mode),))
    description = make_p2at(omni_cameras=(replace(omni, effects=effect_settings),))
    appearance = RobotMeshes([description])
    carrier = Robot(
        description, stand(description, PlanarPose(1, 2, 3)), name="R", seed=0, time_s=0.0
    )
    first, second = appearance.ego_body(carrier), appearance.ego_body(carrier)
    assert first is not None
    assert second is not None
    assert first.mesh is second.mesh
    assert len(first.mesh) < len(appearance.dynamic_objects([carrier])[0].mesh)


def test_ego_body_when_not_configured_is_not_built() -> None:
    omni = make_p2at().omni_camera
    assert omni is not None
    other = replace(omni, effects=EffectSettings((EffectSetting(Vignetting(), EffectMode.AUTO),)))
    for description in (make_p2at(), make_p2at(omni_cameras=(other,)), make_p2at(omni_cameras=())):
        assert build_ego_mesh(description) is None
    assert RobotMeshes([make_p2at()]).ego_body(robot(0.0)) is None
