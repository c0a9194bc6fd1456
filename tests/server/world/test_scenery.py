"""Scenery by script: classes, normals, seeds, and pictures with structure."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.config.world_file import read_world
from catoptra_server.world.scenery import SCENERIES, add_scenery
from catoptra_server.world.shapes import facet_normals
from catoptra_server.world.world_description import Facets, Item
from helpers.configs import WORLDS, write_small_world
from helpers.world_pictures import (
    PLACES,
    find_free_poses,
    load_world,
    measure_structure,
    render_perspective,
)


@pytest.mark.parametrize("name", PLACES)
def test_furnished_world_has_at_least_fifteen_classes_and_one_for_each_object(name: str) -> None:
    classes: dict[str, str] = {}
    for item in read_world(WORLDS / f"{name}.ini")[0].items:
        assert classes.setdefault(item.object_name or item.name, item.class_name)
    assert len(set(classes.values())) >= 15


def test_laboratory_has_a_hundred_objects_and_the_landmarks_of_the_field() -> None:
    world, field = (read_world(WORLDS / f"{n}.ini")[0] for n in ("laboratory", "four_legged_2006"))
    assert len({item.object_name for item in world.items if item.object_name}) >= 100
    assert world.landmarks == field.landmarks
    assert world.starts == field.starts
    lines = [[i.shape for i in one.items if i.class_name == "line"] for one in (world, field)]
    assert lines[0] == lines[1]


def test_furnished_arena_has_the_solids_of_the_plain_one() -> None:
    site, arena = (read_world(WORLDS / f"{name}.ini")[0] for name in ("rescue_site", "arena"))
    places = {
        (item.name, item.shape, item.world_from_item.translation.tobytes())
        for item in site.items
        if not isinstance(item.shape, Facets)
    }
    assert places == {
        (item.name, item.shape, item.world_from_item.translation.tobytes()) for item in arena.items
    }


@pytest.mark.parametrize("name", SCENERIES)
def test_facets_are_wound_as_their_normals_point(name: str) -> None:
    for item in add_scenery(name, 1, ())[0]:
        assert isinstance(item.shape, Facets)
        normals, has_area = facet_normals(item.shape.corners)
        assert has_area.all(), item.name
        np.testing.assert_allclose(np.linalg.norm(item.shape.normals, axis=-1), 1.0, atol=1e-9)
        # Leaves are lit as their crown is.
        if item.material is not None and item.material.texture != "leaves":
            assert (np.einsum("nci,ni->nc", item.shape.normals, normals) > 0.5).all(), item.name


def test_scenery_of_a_seed_is_the_same_and_of_another_differs() -> None:
    def corners(seed: int) -> list[bytes]:
        return [_bytes(item) for item in add_scenery("laboratory", seed, ())[0]]

    assert corners(1) == corners(1)
    assert corners(1) != corners(2)


def _bytes(item: Item) -> bytes:
    assert isinstance(item.shape, Facets)
    return item.shape.corners.tobytes() + item.world_from_item.translation.tobytes()


def test_unknown_scenery_is_an_error_with_all_names(tmp_path: Path) -> None:
    path = write_small_world(tmp_path, "Scenery=(Name=moon)")
    with pytest.raises(ConfigError, match="laboratory"):
        read_world(path)


@pytest.mark.parametrize("name", ["laboratory", "yard"])
def test_pictures_of_a_furnished_world_have_structure(name: str) -> None:
    world = load_world(name)
    camera = PerspectiveCamera(640, 480, math.radians(75.0))
    pictures = render_perspective(world, camera, find_free_poses(world, name, 5))
    flat, bits, ends = np.median([measure_structure(one) for one in pictures], axis=0)
    # A photograph: 11 %, 7.3 bit; the plain field: 77 %, 3.9 bit.
    assert flat <= 0.15
    assert bits >= 6.3
    assert ends <= 0.1
