"""Nodes near casters: all that could be occluded, and hardly any other."""

from __future__ import annotations

import numpy as np

from catoptra_server.render.trace.kernel.scene_arrays import find_flat_surfaces
from catoptra_server.render.trace.occlusion.baking import (
    enclose_casters,
    find_near_pairs,
    frame_surfaces,
    lay_out,
)
from catoptra_server.world.scene_mesh import build_scene
from helpers.standing_things import make_box_world

SCENE = build_scene(make_box_world())
FRAMES = frame_surfaces(SCENE, find_flat_surfaces(SCENE))
LAYOUT = lay_out(FRAMES, 0.1)


def find_floor(radius_m: float) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    """Near nodes of the floor, row by row."""
    near = find_near_pairs(FRAMES, enclose_casters(SCENE.corners), radius_m).find_nodes(LAYOUT)
    left, top, right, bottom = LAYOUT.bounds()[FRAMES.patch_of[0]].tolist()
    return near[top : bottom + 1, left : right + 1]


def test_all_nodes_within_the_radius_of_the_box_are_near() -> None:
    near = find_floor(0.5)
    x, y = np.meshgrid(np.linspace(-4, 4, near.shape[1]), np.linspace(-4, 4, near.shape[0]))
    outside_x, outside_y = np.maximum(np.abs(x) - 0.25, 0), np.maximum(np.abs(y) - 0.2, 0)
    assert near[np.hypot(outside_x, outside_y) <= 0.5].all()
    # The square around the circle, and whole steps.
    assert not near[np.maximum(outside_x, outside_y) > 0.5 + 0.2].any()


def test_floor_is_not_near_itself() -> None:
    low = enclose_casters(SCENE.corners[:2])
    assert not find_near_pairs(FRAMES, low, 0.5).find_nodes(LAYOUT)[LAYOUT.grid_at() == 0].any()


def test_boxes_enclose_every_caster() -> None:
    boxes = enclose_casters(SCENE.corners)
    for corners in SCENE.corners:
        offset = np.abs(corners - boxes.centre[:, None])
        assert (offset <= boxes.half[:, None] + 1e-12).all(axis=(1, 2)).any()
