"""The shipped worlds: a class for each item; surfaces of which a ray meets one, not two."""

import itertools
from collections import defaultdict

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.config.world_file import read_world
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from helpers.configs import WORLDS

# Surfaces nearer than this are one plane; overlaps as narrow are rounding of a common edge.
SAME_PLANE_M = 1e-5


@pytest.mark.parametrize("name", sorted(path.name for path in WORLDS.glob("*.ini")))
def test_shipped_world_has_no_faces_of_two_items_in_one_place(name: str) -> None:
    scene = build_scene(read_world(WORLDS / name)[0])
    found = {
        tuple(
            sorted((scene.item_names[scene.item_index[a]], scene.item_names[scene.item_index[b]]))
        )
        for triangles in _list_planes(scene)
        for a, b in itertools.combinations(triangles, 2)
        if not _do_look_alike(scene, a, b)
        and _do_overlap(scene.corners[a], scene.corners[b], scene.normals[a])
    }
    assert not found


@pytest.mark.parametrize("name", sorted(path.name for path in WORLDS.glob("*.ini")))
def test_each_item_of_a_shipped_world_has_a_class(name: str) -> None:
    assert not [item.name for item in read_world(WORLDS / name)[0].items if not item.class_name]


def _list_planes(scene: SceneMesh) -> list[list[int]]:
    """Triangles of each plane that face the same way: only these are seen in turn.

    Nobody sees what faces down on the ground, z = 0, or below.
    """
    offsets = np.einsum("tk,tk->t", scene.normals, scene.corners[:, 0])
    rows = np.column_stack((scene.normals, offsets))
    planes = defaultdict(list)
    is_hidden = (scene.normals[:, 2] > 0.999) & (offsets > -SAME_PLANE_M)
    keys = np.round(rows / SAME_PLANE_M).astype(np.int64)
    for triangle in np.flatnonzero(~is_hidden).tolist():
        planes[tuple(keys[triangle].tolist())].append(triangle)
    return list(planes.values())


def _do_look_alike(scene: SceneMesh, a: int, b: int) -> bool:
    """Whether two triangles are of one item, or of one colour and texture."""
    return bool(
        scene.item_index[a] == scene.item_index[b]
        or (
            scene.texture_index[a] == scene.texture_index[b]
            and (scene.albedo[a] == scene.albedo[b]).all()
        )
    )


def _do_overlap(a: Floats, b: Floats, normal: Floats) -> bool:
    """Whether no side of two (3, 3) triangles in one plane separates them."""
    for triangle in (a, b):
        sides = np.roll(triangle, -1, axis=0) - triangle
        across = np.cross(normal, sides)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        first, second = across @ a.T, across @ b.T
        gap = np.maximum(
            second.min(axis=1) - first.max(axis=1), first.min(axis=1) - second.max(axis=1)
        )
        if (gap > -SAME_PLANE_M).any():
            return False
    return True
