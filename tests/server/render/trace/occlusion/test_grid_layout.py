"""Grids over surfaces: nodes no farther apart than asked, none shared in the atlas."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.render.trace.kernel.scene_arrays import FlatSurfaces, find_flat_surfaces
from catoptra_server.render.trace.occlusion.baking import (
    SurfaceFrames,
    frame_surfaces,
    lay_out,
)
from catoptra_server.world.occlusion_map import BLOCK
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from helpers.standing_things import make_box_world

SCENE = build_scene(make_box_world())


def frame(scene: SceneMesh = SCENE) -> SurfaceFrames:
    return frame_surfaces(scene, find_flat_surfaces(scene))


def test_every_corner_of_a_triangle_lies_in_its_surface_s_rectangle() -> None:
    frames = frame()
    assert len(frames.origin) == 7  # the floor and six sides
    for corners, patch in zip(SCENE.corners, frames.patch_of, strict=True):
        sides = np.stack((frames.side_x[patch], frames.side_y[patch]))
        at = (corners - frames.origin[patch]) @ np.linalg.pinv(sides)
        assert (at > -1e-9).all()
        assert (at < 1.0 + 1e-9).all()
        np.testing.assert_allclose(at @ sides + frames.origin[patch], corners, atol=1e-9)


def test_small_triangles_have_grids_between_their_corners() -> None:
    flat = find_flat_surfaces(SCENE)
    none = flat.triangles[:0]
    frames = frame_surfaces(
        SCENE, FlatSurfaces(none, none, flat.outer_edges[:0], none, flat.clusters)
    )
    assert sorted(frames.patch_of.tolist()) == list(range(len(SCENE)))
    third = (frames.origin + frames.side_y)[frames.patch_of]
    np.testing.assert_allclose(third, SCENE.corners[:, 2], atol=1e-12)


@pytest.mark.parametrize("distance_m", [0.03, 0.2, 50.0])
def test_grids_share_no_block_of_the_atlas(distance_m: float) -> None:
    layout = lay_out(frame(), distance_m)
    used = np.zeros((layout.height, layout.width), dtype=int)
    for x, y, w, h in zip(layout.left, layout.top, layout.columns, layout.rows, strict=True):
        assert x % BLOCK == y % BLOCK == 0
        assert min(w, h) >= 2
        used[y : y + -(-h // BLOCK) * BLOCK, x : x + -(-w // BLOCK) * BLOCK] += 1
    assert used.max() == 1
    grid = layout.grid_at()
    for number, (left, top, right, bottom) in enumerate(layout.bounds().tolist()):
        assert (grid[top : bottom + 1, left : right + 1] == number).all()


def test_nodes_are_at_most_as_far_apart_as_asked() -> None:
    frames = frame()
    layout = lay_out(frames, 0.07)
    for sides, count in ((frames.side_x, layout.columns), (frames.side_y, layout.rows)):
        assert (np.linalg.norm(sides, axis=-1) / (count - 1)).max() <= 0.07 + 1e-9
