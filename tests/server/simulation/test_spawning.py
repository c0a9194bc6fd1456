"""Class, place and name of INIT; meshes of robots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.usarsim.commands import Init
from catoptra_protocol.usarsim.reports import StartPose
from catoptra_server.effects import EffectMode, EffectSetting, EffectSettings
from catoptra_server.effects.medium.vignetting import Vignetting
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import PlanarPose, RobotDescription
from catoptra_server.simulation.spawning import (
    PlaceTest,
    RobotMeshes,
    SpawnError,
    build_ego_mesh,
    find_class,
    place_robot,
    unique_name,
)
from catoptra_server.world.world_description import Twist
from helpers.robots import make_p2at, make_walled_world

CLASSES = (make_p2at(class_name="USARBot.P2AT"), make_p2at(class_name="USARBot.P2DX"))
STARTS = make_walled_world().starts


@pytest.mark.parametrize(("name", "index"), [("P2DX", 1), ("usarbot.p2at", 0)])
def test_class_when_named_is_found_in_any_case(name: str, index: int) -> None:
    assert find_class(CLASSES, name) is CLASSES[index]


@pytest.mark.parametrize("name", ["P2", ""])
def test_class_when_unknown_is_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(SpawnError, match=r"no class '.*': this server has USARBot.P2AT, USARBot"):
        find_class(CLASSES, name)


def spawn_pose(init: Init, starts: Sequence[StartPose]) -> PlanarPose:
    """Requested pose where all places are free."""
    are_free: PlaceTest = lambda places, _: np.ones(len(places), dtype=np.bool_)  # noqa: E731
    return place_robot(init, CLASSES, starts, lambda *_: are_free)[1]


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


def find_free_pose(are_free: PlaceTest) -> PlanarPose:
    """Pose of a robot that is requested at (3, 4)."""
    init = Init("P2AT", location_m=(3.0, 4.0, 0.0), rotation_rad=(0.0, 0.0, 0.7))
    description, requested, pose = place_robot(init, CLASSES, (), lambda *_: are_free)
    assert (description, requested) == (CLASSES[0], REQUESTED)
    return pose


def nothing_within(radius_m: float) -> tuple[list[int], PlaceTest]:
    """Test of places that refuses all nearer to (3, 4) than a radius; and the numbers tested."""
    counts: list[int] = []

    def are_free(places: Floats, clearance_m: float) -> Bools:
        counts.append(len(places))
        free: Bools = np.hypot(*(places - (3.0, 4.0)).T) >= radius_m
        return free

    return counts, are_free


REQUESTED = PlanarPose(3.0, 4.0, 0.7)


def test_free_pose_is_kept_to_the_last_bit_after_one_test() -> None:
    counts, are_free = nothing_within(0.0)
    assert find_free_pose(are_free) == REQUESTED
    assert counts == [1]


@pytest.mark.parametrize("radius_m", [0.05, 0.3, 1.0, 1.95, 2.0, 2.1, 5.0, 8.0])
def test_pose_that_is_not_free_moves_to_the_nearest_place(radius_m: float) -> None:
    _, are_free = nothing_within(radius_m - 1e-9)
    pose = find_free_pose(are_free)
    moved_m = math.hypot(pose.x_m - 3.0, pose.y_m - 4.0)
    # The grid has steps of 0.1 m, and of 0.4 m beyond 2 m.
    step_m, end_m = (0.1, 2.0) if radius_m <= 2.0 else (0.4, 8.0)
    assert radius_m - 1e-9 <= moved_m <= min(radius_m + step_m, end_m + 1e-9)
    assert pose.yaw_rad == REQUESTED.yaw_rad
    assert pose == find_free_pose(are_free)


def test_pose_without_a_free_place_within_8_m_is_refused() -> None:
    _, are_free = nothing_within(8.0 + 0.01)
    with pytest.raises(SpawnError, match="no free place within 8 m of 3,4"):
        find_free_pose(are_free)


def test_places_have_clearance_that_the_requested_one_need_not_have() -> None:
    clearances: list[float] = []

    def are_free(places: Floats, clearance_m: float) -> Bools:
        clearances.append(clearance_m)
        return np.full(len(places), clearance_m > 0.0)

    find_free_pose(are_free)
    assert clearances[0] == 0.0
    assert min(clearances[1:]) > 0.01


def test_name_in_use_gets_the_first_free_number() -> None:
    assert unique_name("R", {"R", "R2", "R4"}) == "R3"
    assert unique_name("R", set()) == "R"


def test_robot_when_its_place_is_taken_stands_beside_it() -> None:
    tested: list[tuple[str, float]] = []

    def make_place_test(description: RobotDescription, yaw_rad: float) -> PlaceTest:
        tested.append((description.class_name, yaw_rad))
        return lambda places, clearance_m: np.abs(places[:, 0] - 1.0) > 0.25

    init = Init("P2DX", start="aside")
    description, requested, pose = place_robot(init, CLASSES, STARTS, make_place_test)
    assert description is CLASSES[1]
    assert tested == [("USARBot.P2DX", 1.5)]
    assert requested == PlanarPose(1.0, -2.0, 1.5)
    assert 0.25 < abs(pose.x_m - 1.0) < 0.5


def robot(x_m: float) -> Robot:
    place = PlanarPose(x_m, 0.5, 1.0)
    return Robot(make_p2at(), place, name=f"R{x_m}", seed=0, time_s=0.0)


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
    one.world_from_robot = one.world_from_robot @ one.world_from_robot
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
    carrier = Robot(description, PlanarPose(1, 2, 3), name="R", seed=0, time_s=0.0)
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
