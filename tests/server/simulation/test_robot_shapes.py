"""Robots as others see them: within their dimensions, with the camera model's mirror on top."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import ConicalMirror, ParabolicMirror
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.configurations import CHASSIS_MOUNT
from catoptra_server.config.robot_file import read_robots
from catoptra_server.frames.labels import SceneLabels
from catoptra_server.simulation.fleet_cameras import RobotMeshes
from catoptra_server.simulation.robot_bodies import (
    OmniCameraTower,
    RobotDimensions,
    build_carrier_mesh,
    build_ego_body_mesh,
    build_outer_meshes,
    build_robot_mesh,
)
from catoptra_server.simulation.robot_description import ANGLE, BodyKind, PlanarPose
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.configs import ROBOTS
from helpers.robots import make_ground, make_robot_at
from helpers.worlds import make_omni_camera

P2AT = RobotDimensions((0.5238, 0.4968, 0.2913), 0.1457, 0.13, 0.2884)
P3AT = RobotDimensions((0.2480, 0.3600, 0.0), 0.098, 0.098, 0.2480)
MIRROR_ALBEDO = 0.55  # no other part's
TOWER = OmniCameraTower(make_omni_camera(), Pose.from_rpy((0.05, 0.0, -0.4543)))


def test_robot_stands_on_the_floor_within_its_dimensions() -> None:
    corners = build_robot_mesh(P2AT).corners
    low, high = corners.min((0, 1)), corners.max((0, 1))
    assert high[2] == pytest.approx(P2AT.ride_height_m), "the lowest point is the floor"
    assert low[2] == pytest.approx(P2AT.ride_height_m - P2AT.dimensions_m[2])
    assert high[1] - low[1] == pytest.approx(P2AT.dimensions_m[1])


def test_robot_without_height_is_as_high_as_its_wheels() -> None:
    corners = build_robot_mesh(P3AT).corners
    assert np.ptp(corners[..., 2]) == pytest.approx(2.0 * P3AT.wheel_radius_m)


def test_robot_without_a_wheel_base_has_one_pair() -> None:
    two = RobotDimensions(P2AT.dimensions_m, P2AT.ride_height_m, P2AT.wheel_radius_m, 0.0)
    wheel = (len(build_robot_mesh(P2AT)) - len(build_robot_mesh(two))) // 2
    assert len(build_robot_mesh(two)) == 24 + 2 * wheel


def is_mirror_triangle(tower: OmniCameraTower) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    chosen: np.ndarray[tuple[int], np.dtype[np.bool_]]
    chosen = (build_robot_mesh(P2AT, tower).albedo == MIRROR_ALBEDO).all(axis=-1)
    return chosen


def test_mirror_lies_on_the_camera_models_surface_and_faces_outwards() -> None:
    mesh, chosen = build_robot_mesh(P2AT, TOWER), is_mirror_triangle(TOWER)
    corners, normals = mesh.corners[chosen], mesh.normals[chosen]
    inside = corners.mean(axis=(0, 1))
    assert (np.einsum("ni,ni->n", normals, corners.mean(axis=1) - inside) > 0.0).all()
    in_mirror = TOWER.robot_from_mirror.inverse().transform_points(corners)
    apex_z = float(TOWER.camera.mirror.surface_point(np.array(0.0))[1])
    rim_r, rim_z = TOWER.camera.mirror.surface_point(np.array(TOWER.camera.rim_t))
    assert in_mirror[..., 2].max() == pytest.approx(apex_z)
    assert in_mirror[..., 2].min() == pytest.approx(float(rim_z))
    assert np.hypot(*np.moveaxis(in_mirror[..., :2], -1, 0)).max() == pytest.approx(float(rim_r))


def test_cone_reaches_from_its_apex_to_the_rim() -> None:
    cone = ConicalMirror(math.radians(60.0), 0.1, math.radians(100.0))
    tower = OmniCameraTower(
        make_omni_camera(mirror=cone, rim_deg=100.0), Pose.from_rpy((0.05, 0.0, -0.4543))
    )
    chosen = is_mirror_triangle(tower)
    corners = build_robot_mesh(P2AT, tower).corners[chosen] - tower.robot_from_mirror.translation
    # Seen from the pinhole, the apex of a cone is its nearest point.
    pinhole_from_apex_m = cone.pinhole_distance_m - corners[..., 2].max()
    assert pinhole_from_apex_m == pytest.approx(0.1)
    rim_r, rim_z = cone.surface_point(np.array(tower.camera.rim_t))
    assert corners[..., 2].min() == pytest.approx(float(rim_z))
    assert np.hypot(corners[..., 0], corners[..., 1]).max() == pytest.approx(float(rim_r))


def test_pillar_ends_at_the_pinhole_and_without_one_at_the_deck() -> None:
    flat = OmniCameraTower(make_omni_camera(mirror=ParabolicMirror(0.03)), TOWER.robot_from_mirror)
    # One post less: only what carries the mirror stands on the deck.
    assert len(build_robot_mesh(P2AT, TOWER)) - len(build_robot_mesh(P2AT, flat)) == 80


def test_ego_body_ends_at_the_pinhole_and_has_neither_mirror_nor_support() -> None:
    mesh = build_ego_body_mesh(P2AT, TOWER)
    above_deck = mesh.corners[mesh.corners[..., 2].min(axis=1) < -0.15]
    assert above_deck[..., 2].min() == pytest.approx(-0.4543 + 0.2321)
    aside = np.hypot(above_deck[..., 0] - 0.05, above_deck[..., 1])
    assert aside.max() == pytest.approx(0.03), "the pillar is the widest part of the tower"
    assert not (mesh.albedo == MIRROR_ALBEDO).any()


def test_ego_body_without_a_pinhole_ends_at_the_deck() -> None:
    tower = OmniCameraTower(
        make_omni_camera(mirror=ParabolicMirror(0.03), rim_deg=110.0), TOWER.robot_from_mirror
    )
    mesh = build_ego_body_mesh(P2AT, tower)
    assert len(mesh) == len(build_robot_mesh(P2AT))


BUNDLED = {
    f"{path.stem} {one.model_name}": one
    for path in sorted(ROBOTS.glob("*.ini"))
    for one in read_robots(path)[0]
    if not one.drive.is_tripod
}
KENAF = BUNDLED["kenaf Kenaf"]


def test_paper_s_robot_and_what_is_based_on_it_are_plain_and_all_others_of_parts() -> None:
    kinds = {name: one.body for name, one in BUNDLED.items() if one.body != "wheels"}
    paper = ("p2at_omni", "p2at_omni_full", "p2at_omni_real", "p2at_omni_scout", "p2at_omni_sim")
    assert kinds == {
        **{f"{name} OmniP2AT": "plain" for name in paper},
        "p2at_sphere SphereP2AT": "plain",
        "p2at_sphere OmniP2AT": "plain",
        "omni_p2dx OmniP2DX": "castor",
        "omni_p2dx P2DX": "castor",
        "p2dx P2DX": "castor",
        "kenaf Kenaf": "tracks",
    }
    plain = BUNDLED["p2at_omni OmniP2AT"]
    assert plain.omni_camera is not None
    tower = OmniCameraTower(plain.omni_camera.camera, plain.omni_camera.robot_from_mirror)
    (mesh,) = build_outer_meshes(plain).values()
    np.testing.assert_array_equal(mesh.corners, build_robot_mesh(P2AT, tower).corners)


@pytest.mark.parametrize("name", [name for name, one in BUNDLED.items() if one.body != "plain"])
def test_body_of_parts_fills_its_own_dimensions_with_few_triangles(name: str) -> None:
    robot = BUNDLED[name]
    meshes, drive = build_outer_meshes(robot), robot.drive
    body = meshes[CHASSIS_MOUNT]
    assert list(meshes)[-1] == CHASSIS_MOUNT
    assert sum(map(len, meshes.values())) < 8200
    low, high = body.corners.min((0, 1)), body.corners.max((0, 1))
    # The lugs of a tyre need not be at its lowest point.
    assert drive.ride_height_m - 0.003 < high[2] < drive.ride_height_m + 1e-9
    sides = (np.array((-low[1], high[1])) - 0.5 * drive.collision_size_m[1]) <= 1e-9
    assert sides.all(), "tyres and tracks end with the robot's sides"
    assert np.ptp(body.corners[..., 0]) < 1.07 * drive.collision_size_m[0]
    smooth, normals = body.corner_normals, np.linalg.norm(body.normals, axis=1)
    assert smooth is not None
    np.testing.assert_allclose(normals, 1.0, atol=1e-9)
    turned = np.einsum("nki,ni->nk", smooth, body.normals)
    assert turned.min() > math.cos(math.radians(30.0)), "edges of more are hard"
    assert body.bent is not None
    assert 0.1 < body.bent.mean() < 0.9


@pytest.mark.parametrize("kind", ["wheels", "castor", "tracks"])
@pytest.mark.parametrize("size_m", [(0.001, 0.001, 0.001), (3.0, 0.1, 0.05), (0.1, 3.0, 2.0)])
@pytest.mark.parametrize("radius_m", [0.001, 0.5])
def test_body_of_any_numbers_is_a_mesh(
    kind: BodyKind, size_m: tuple[float, float, float], radius_m: float
) -> None:
    robot = BUNDLED["p2at P2AT"]
    drive = replace(robot.drive, dimensions_m=size_m, wheel_radius_m=radius_m)
    for mesh in build_outer_meshes(replace(robot, drive=drive, body=kind)).values():
        assert np.isfinite(mesh.corners).all()
        assert mesh.corner_normals is not None
        np.testing.assert_allclose(np.linalg.norm(mesh.corner_normals, axis=-1), 1.0, atol=1e-6)


def test_tyres_and_sonars_stand_where_the_file_says() -> None:
    robot = BUNDLED["p2at P2AT"]
    body = build_outer_meshes(robot)[CHASSIS_MOUNT]
    gold = body.corners[(body.albedo == (0.52, 0.38, 0.16)).all(axis=1)]
    facing = body.normals[(body.albedo == (0.52, 0.38, 0.16)).all(axis=1)]
    # F4 looks 10 degrees to the left, R5 the same way behind.
    for x, y, yaw in ((0.24, -0.025, -0.1745), (-0.24, -0.025, -2.9671)):
        axis = np.array((math.cos(yaw), math.sin(yaw), 0.0))
        middle = gold.mean(axis=1)
        front = gold[(facing @ axis > 0.9999) & (np.abs(middle[:, :2] - (x, y)).max(1) < 0.06)]
        offset = front.reshape(-1, 3) - (x, y, 0.0)
        aside = np.linalg.norm(offset - np.outer(offset @ axis, axis), axis=1)
        assert aside.max() == pytest.approx(0.019, abs=1e-5)


def test_flippers_turn_with_their_joints_and_stay_one_object_in_labels() -> None:
    robot = make_robot_at(KENAF, PlanarPose(1.0, 2.0, 0.5), name="K", seed=0, time_s=0.0)
    fleet = RobotMeshes([KENAF])
    *level, body = fleet.dynamic_objects([robot])
    assert fleet.dynamic_objects([robot]) == (*level, body), "the same until something moves"
    robot.drive_joint("FRFlipper", -1.0, ANGLE)
    for _ in range(100):
        robot.step(0.02, 0.02, make_ground().move)
    *raised, same = fleet.dynamic_objects([robot])
    assert [one.mesh for one in raised] == [one.mesh for one in level]
    assert same.mesh is body.mesh
    tips = [one.world_from_object.transform_points(one.mesh.corners)[..., 2] for one in raised]
    # z points down: 0.19 m between the axles, and the tip's radius.
    assert tips[0].min() == pytest.approx(-0.05 - 0.19 * math.sin(1.0) - 0.03, abs=0.004)
    assert all(tip.min() == pytest.approx(-0.1, abs=0.004) for tip in tips[1:])
    described = SceneLabels(build_scene(World("empty", ()))).describe((*raised, same))
    assert [one.name for one in described] == ["K"]
    np.testing.assert_array_equal(described[0].half_size_m, body.mesh.half_size_m)


def test_arm_reaches_from_joint_to_joint() -> None:
    meshes = build_outer_meshes(BUNDLED["legacy KR6"])
    # Joint 3 stands 0.68 m above joint 2.
    assert meshes["joint2"].corners[..., 2].min() == pytest.approx(-0.68)
    assert len(meshes) == 7


def test_own_mirror_sees_no_rods_and_the_head_of_the_pan_tilt_camera() -> None:
    live = BUNDLED["p2at_omni_live OmniP2AT"]
    own, outer = build_carrier_mesh(live), build_outer_meshes(live)
    assert own.corners[..., 2].min() == pytest.approx(-0.2635 + 0.0613 - 0.036, abs=1e-3)
    assert outer[CHASSIS_MOUNT].corners[..., 2].min() < -0.48
