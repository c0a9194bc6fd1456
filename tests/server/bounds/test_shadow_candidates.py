from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.bounds.shadows import AxisAlignedBox, make_bound, shadow_candidates
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import DirectionalLight, PointLight, World
from helpers.shadows import (
    DIRECTIONAL_LIGHT,
    POINT_LIGHT,
    box_item,
    floor_item,
    make_inward_facing_room,
    make_world,
)

INSIDE = PointLight((0.3, 0.2, -1.1), (0.9, 0.9, 0.9))


def names(world: World, light: DirectionalLight | PointLight) -> set[str]:
    """Names of the items with candidates for a shadow."""
    scene = build_scene(world)
    return {
        scene.item_names[i] for i in np.unique(scene.item_index[shadow_candidates(scene, light)])
    }


@pytest.mark.parametrize("light", [DIRECTIONAL_LIGHT, POINT_LIGHT])
def test_floor_alone_or_from_below_is_no_candidate(
    light: DirectionalLight | PointLight,
) -> None:
    assert names(make_world(floor_item()), light) == set()
    assert names(make_world(floor_item(), box_item(0, 0, 0.5, (0.2, 0.2, 0.2))), light) == {"box"}


@pytest.mark.parametrize("light", [DIRECTIONAL_LIGHT, POINT_LIGHT])
def test_floor_under_a_box_is_a_candidate(light: DirectionalLight | PointLight) -> None:
    assert "floor" in names(make_world(floor_item(), box_item(0, 0, -0.1, (0.2, 0.2, 0.2))), light)


def test_empty_convex_room_has_no_candidates() -> None:
    assert names(make_inward_facing_room(INSIDE), INSIDE) == set()


def test_single_box_has_no_candidates() -> None:
    assert names(make_world(box_item(0, 0, -0.1, (0.2, 0.2, 0.2))), DIRECTIONAL_LIGHT) == set()


def test_scene_without_triangles_has_no_candidates() -> None:
    assert names(World("empty", ()), DIRECTIONAL_LIGHT) == set()


def test_bound_of_many_corners_is_their_box() -> None:
    rng = np.random.default_rng(3)
    corners = rng.normal(size=(400, 3, 3))
    normals = rng.normal(size=(50, 3))
    exact = make_bound(corners, num_planes=50).support(normals)
    boxed = make_bound(corners, num_planes=10**6)
    np.testing.assert_allclose(exact, (corners.reshape(-1, 3) @ normals.T).max(axis=0))
    assert isinstance(boxed, AxisAlignedBox)
    assert (boxed.support(normals) >= exact).all()
