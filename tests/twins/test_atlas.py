"""include/atlas.glsl against the float64 cube."""

from __future__ import annotations

import math

import moderngl
import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.frames.plan.faces import face_regions
from catoptra_server.render.projection.atlas import GUARD_TEXELS, Atlas, pack_atlas
from helpers.shaders import atlas_texels
from helpers.worlds import make_omni_camera, regions_of_size

SIZE = 672


def make_atlas(limit_rad: float = math.pi - 1e-3) -> Atlas:
    return pack_atlas(regions_of_size(limit_rad, SIZE), guard_texels=GUARD_TEXELS, max_texels=4096)


def random_directions(count: int) -> Floats:
    values = np.random.default_rng(5).normal(size=(count, 3)).astype(np.float32)
    return values.astype(np.float64)


@pytest.mark.parametrize("rim_deg", [90.0, 120.0, 140.0])
def test_coordinates_in_regions_of_their_own_density_equal_the_cube(
    context: moderngl.Context, rim_deg: float
) -> None:
    camera = make_omni_camera(width_px=640, rim_deg=rim_deg)
    parts = face_regions(camera, camera.rim_rad, size_px=0, texels_per_px=1.0)
    atlas = pack_atlas(parts, guard_texels=GUARD_TEXELS, max_texels=4096)
    directions = random_directions(20_000)
    seen = np.arccos(directions[:, 2] / np.linalg.norm(directions, axis=-1)) < camera.rim_rad
    directions = directions[seen]
    difference = atlas_texels(context, atlas, directions) - atlas.texels_from_direction(directions)
    assert np.abs(difference).max() < 2e-3


def test_direction_beyond_five_faces_is_held_at_a_side_faces_edge(
    context: moderngl.Context,
) -> None:
    atlas = make_atlas(math.radians(125.0))
    texel = atlas_texels(context, atlas, np.array([[1.0, 0.0, -2.0], [0.0, 0.0, -1.0]]))
    x, y, _, rows = atlas.texel_transforms()[Face.N]
    assert texel[0] == pytest.approx((x, y - rows), abs=2e-3)
    assert np.isfinite(texel).all()
