"""Replies of a mounted part; the nearer of scene and boxes."""

from __future__ import annotations

import dataclasses

import numpy as np

from catoptra_protocol.usarsim.reports import Configuration, GeometryItem
from catoptra_server.simulation.robot_description import Mount
from catoptra_server.simulation.sensors import EMPTY_ENVIRONMENT, SensorEnvironment
from helpers.robots import RFID, make_sensor
from helpers.room_ray_caster import RoomRayCaster, oriented_box_at


def test_part_replies_with_its_configuration_and_mount() -> None:
    mount = Mount((1.0, 2.0, 3.0), (0.1, 0.2, 0.3), "CameraTilt")
    (part,) = make_sensor(dataclasses.replace(RFID, mount=mount)).parts
    pairs = (("Name", "RFID"), ("MaxRange", "2.0000"))
    assert part.configuration() == Configuration("RFID", pairs)
    assert part.geometry() == GeometryItem("RFID", (1.0, 2.0, 3.0), (0.1, 0.2, 0.3), "CameraTilt")


RAYS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def test_distances_when_a_body_is_nearer_are_to_it() -> None:
    around = SensorEnvironment(RoomRayCaster(), [oriented_box_at(2.0, 0.0)])
    assert around.distances(np.zeros(3), RAYS).tolist() == [1.8, 3.0]


def test_distances_when_there_is_nothing_are_infinite() -> None:
    assert np.isinf(EMPTY_ENVIRONMENT.distances(np.zeros(3), RAYS)).all()


def test_hits_of_a_nearer_box_have_its_normal() -> None:
    around = SensorEnvironment(RoomRayCaster(), [oriented_box_at(2.0, 0.0)])
    distances, normals = around.closest_hits(np.zeros(3), RAYS)
    assert distances.tolist() == [1.8, 3.0]
    np.testing.assert_array_equal(normals, [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def test_hits_when_there_is_nothing_are_infinite_and_without_normal() -> None:
    distances, normals = EMPTY_ENVIRONMENT.closest_hits(np.zeros(3), RAYS)
    assert np.isinf(distances).all()
    assert not normals.any()
