"""Numbers, classes and boxes of objects."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.labels import labels as scene_labels
from catoptra_server.frames.labels.labels import SceneLabels
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, World
from helpers.labelled_rooms import ROBOTS, SCENE

GREY = Material((0.5, 0.5, 0.5))


def box_item(name: str, x: float, yaw: float = 0.0, **names: str) -> Item:
    pose = Pose.from_rpy((x, 1.0, -0.5), (0.0, 0.0, yaw))
    return Item(name, Box((1.0, 0.5, 0.25)), pose, GREY, **names)


def test_items_of_one_object_share_a_number() -> None:
    items = (
        box_item("leg1", 0.0, object_name="table", class_name="furniture"),
        box_item("door", 3.0),
        box_item("leg2", 1.0, object_name="table", class_name="furniture"),
    )
    scene = build_scene(World("w", items))
    labels = SceneLabels(scene)
    assert [one.name for one in scene.objects] == ["table", "door"]
    assert labels.classes == ("furniture", "object", "robot")
    table, door = labels.describe(())
    assert (table.number, table.class_number, door.class_name) == (1, 1, "object")
    np.testing.assert_allclose(table.half_size_m, (1.0, 0.25, 0.125))
    np.testing.assert_array_equal(np.unique(labels.triangle_numbers), (1, 2))


def test_box_of_a_turned_thing_turns_with_it() -> None:
    (one,) = SceneLabels(build_scene(World("w", (box_item("box", 2.0, 0.4),)))).describe(())
    assert sorted(one.half_size_m.round(9)) == [0.125, 0.25, 0.5]
    expected = Pose.from_rpy((2.0, 1.0, -0.5), (0.0, 0.0, 0.4))
    np.testing.assert_allclose(one.world_from_box.translation, expected.translation, atol=1e-9)
    heading = math.atan2(*one.world_from_box.rotation[(1, 0), (0, 0)])
    assert heading % (0.5 * math.pi) == pytest.approx(0.4, abs=1e-6)


def test_landmarks_are_one_object_each() -> None:
    beacon = Landmark("b", "beacon", 1.0, 2.0, 0.0, 0.2, 0.2, 0.4, "red", "blue")
    colours = {"red": (1.0, 0.0, 0.0), "blue": (0.0, 0.0, 1.0)}
    world = World("w", (box_item("box", 0.0),), (beacon,), landmark_albedos=colours)
    found = SceneLabels(build_scene(world)).describe(())
    assert [(one.name, one.class_name) for one in found] == [("box", "object"), ("b", "beacon")]


def test_robots_follow_the_world_in_the_order_of_spawning() -> None:
    labels = SceneLabels(SCENE)
    found = labels.describe(ROBOTS[::-1])
    assert [one.name for one in found[-2:]] == ["Robot1", "Robot2"]
    assert [one.number for one in found] == list(range(1, 8))
    assert labels.class_table[6] == labels.class_table[40000] == labels.classes.index("robot") + 1
    box = found[-1]
    corners = ROBOTS[1].mesh.corners.reshape(-1, 3)
    world = ROBOTS[1].world_from_object.transform_points(corners)
    inside = box.world_from_box.inverse().transform_points(world)
    assert (np.abs(inside) <= box.half_size_m + 1e-9).all()


def test_numbers_of_robots_stay_below_the_largest() -> None:
    labels = SceneLabels(SCENE)
    number = labels.number_of(replace(ROBOTS[0], number=10**6))
    assert len(SCENE.objects) < number <= 65535


def test_world_of_too_many_objects_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scene_labels, "MAX_OBJECTS", 4)
    with pytest.raises(DomainError, match="5 objects, and labels number at most 4"):
        SceneLabels(SCENE)
