"""Robots as others see them: within their dimensions, with the camera model's mirror on top."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import ConicalMirror, ParabolicMirror
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.simulation.robot_bodies import (
    OmniCameraTower,
    RobotDimensions,
    build_ego_body_mesh,
    build_robot_mesh,
)
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
