"""Rays of labels with their times; numbers, classes and boxes of objects."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.labels.annotations import project_boxes
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.camera_rays import pixel_from_point
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.medium.misalignment import Misalignment
from catoptra_server.frames import labels as scene_labels
from catoptra_server.frames.labels import (
    LabelledImage,
    RaySource,
    SceneLabels,
    build_label_rays,
    label_exposure,
)
from catoptra_server.render.trace.trace_engine import MovingExposure, assemble_grid
from catoptra_server.world.objects import INSTANTANEOUS, DynamicObject, Shutter
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, Twist, World
from helpers.labelled_rooms import CAMERAS, ROBOTS, SCENE, STATE

CAMERA = CAMERAS["paper"]
ROLLING = INSTANTANEOUS.add_exposure(0.01, 1.0).add_readout(0.03, 4.0)


def ray_source_under(shutter: Shutter) -> RaySource:
    return LabelledImage(CAMERA, replace(STATE, shutter=shutter)).ray_source


def test_exposure_time_alone_changes_no_ray() -> None:
    blurred = ray_source_under(INSTANTANEOUS.add_exposure(0.01, 1.0))
    assert blurred == RaySource(CAMERA)
    assert build_label_rays(blurred, 1).times is None


def test_rows_have_times_around_the_middle() -> None:
    for samples in (1, 3):
        table = build_label_rays(ray_source_under(ROLLING), samples)
        assert table.times is not None
        image = assemble_grid(table, table.times[..., None], fill=np.float32(np.nan))[..., 0]
        rows = np.nanmean(image[samples // 2 :: samples], axis=1)
        expected = 0.5 + 0.03 / 0.04 * ((np.arange(96) + 0.5) / 96 - 0.5)
        seen = np.isfinite(rows)
        np.testing.assert_allclose(rows[seen], expected[seen], atol=1e-6)


def test_displaced_camera_has_rays_of_its_own() -> None:
    displaced = build_label_rays(RaySource(CAMERA, Misalignment(x_m=0.003)), 1)
    aligned = build_label_rays(RaySource(CAMERA), 1)
    common = np.isin(displaced.tiles, aligned.tiles)
    there = np.searchsorted(aligned.tiles, displaced.tiles[common])
    turn = np.abs(displaced.directions[common] - aligned.directions[there])
    assert 0.001 < np.median(turn) < 0.1


def test_labels_know_neither_light_nor_air() -> None:
    state = replace(STATE, has_shadows=True, shutter=ROLLING, twist=Twist((1.0, 0.0, 0.0)))
    exposure = label_exposure(state)
    assert isinstance(exposure, MovingExposure)
    assert not any(one.has_shadows or one.shutter for one in exposure.states)
    still = label_exposure(replace(state, shutter=None))
    assert not isinstance(still, MovingExposure)
    assert not still.has_shadows


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


@pytest.mark.parametrize("seed", range(6))
def test_box_of_a_tipped_thing_has_the_corners_of_the_thing(seed: int) -> None:
    random = np.random.default_rng(seed)
    pose = Pose.from_rpy(random.uniform((1, -1, -1), (3, 1, 1)), random.uniform(-3, 3, 3))
    size = random.uniform(0.1, 1.0, 3)
    item = Item("crate", Box((float(size[0]), float(size[1]), float(size[2]))), pose, GREY)
    found = SceneLabels(build_scene(World("w", (item,)))).describe(())
    signs = np.array([[(row >> axis & 1) - 0.5 for axis in range(3)] for row in range(8)])
    truth = pose.transform_points(signs * size)
    camera = CAMERAS["fish-eye"]
    expected, valid = pixel_from_point(camera, truth)
    pixels, _ = project_boxes(found, camera, Pose.identity())
    assert valid.any()
    # Upright hulls were 3.7 px off.
    np.testing.assert_allclose(pixels[0][valid], expected[valid], atol=1e-6)


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
    monkeypatch.setattr(scene_labels, "_MAX_OBJECTS", 4)
    with pytest.raises(DomainError, match="5 objects, and labels number at most 4"):
        SceneLabels(SCENE)


def test_fixed_classes_give_objects_numbers_that_follow_from_their_names() -> None:
    boxes = [box_item(f"box {number}", 2.0 * number, 0.4) for number in range(40)]
    numbers = {"object": 7, "robot": 3, "distractor": 300}
    found = []
    for items in (boxes, [box_item("another", -3.0, 0.4), *boxes]):
        labels = SceneLabels(build_scene(World("w", tuple(items))), numbers, ("distractor",))
        moving = [
            DynamicObject(ROBOTS[0].mesh, Pose.identity(), number=n, class_name=name, name=name)
            for n, name in ((2, "robot"), (128, "distractor"))
        ]
        described = labels.describe(tuple(moving))
        assert [one.number for one in described] == sorted(one.number for one in described)
        assert {one.class_name: one.class_number for one in described} == numbers
        table = labels.find_class_table(tuple(moving))
        assert all(table[one.number] == one.class_number for one in described)
        found.append({one.name: one.number for one in described})
    assert len(set(found[1].values())) == 43
    assert found[0].items() <= found[1].items(), "the box in front renumbers nothing"


def test_class_without_a_number_is_an_error() -> None:
    with pytest.raises(DomainError, match="without a number: robot"):
        SceneLabels(SCENE, {one.class_name: 1 for one in SCENE.objects})
