"""include/atlas.glsl against the float64 cube."""

from __future__ import annotations

import math

import moderngl
import numpy as np
import pytest

from catoptra_protocol.optics.cube import Face, face_coordinates, face_from_direction
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.raster.atlas import GUARD_TEXELS, Atlas, pack_atlas
from catoptra_server.render.raster.atlas_lookup import atlas_definitions
from helpers.shaders import evaluate

SIZE = 672


def make_atlas(faces: tuple[Face, ...]) -> Atlas:
    return pack_atlas(faces, size=SIZE, limit_rad=math.pi, guard=GUARD_TEXELS, max_texels=4096)


def shader_texels(context: moderngl.Context, atlas: Atlas, directions: Floats) -> Floats:
    define = atlas_definitions(atlas)
    out = evaluate(
        context,
        "atlas_position.frag",
        include="include/atlas.glsl",
        inputs=(directions,),
        uniforms={
            "face_centre": atlas.face_centres()[: dict(define)["FACES"]],
            "texels_per_unit": 0.5 * SIZE,
            "atlas_texel": (1.0 / atlas.width, 1.0 / atlas.height),
        },
        define=define,
    )
    return out[:, :2] * (atlas.width, atlas.height)


def twin_texels(atlas: Atlas, directions: Floats) -> Floats:
    face = face_from_direction(directions)
    return atlas.face_centres()[face] + face_coordinates(directions, face) * 0.5 * SIZE


def random_directions(count: int) -> Floats:
    values = np.random.default_rng(5).normal(size=(count, 3)).astype(np.float32)
    return values.astype(np.float64)


def test_place_of_any_direction_equals_the_cube(context: moderngl.Context) -> None:
    atlas = make_atlas(tuple(Face))
    directions = random_directions(20_000)
    difference = shader_texels(context, atlas, directions) - twin_texels(atlas, directions)
    # float32 places in a texture of 4000 texels: 4000 * 2^-23 and the rounding of the division.
    assert np.abs(difference).max() < 2e-3


@pytest.mark.parametrize("corner", [(1, 1, 1), (-1, 1, 1), (1, -1, -1), (-1, -1, -1)])
@pytest.mark.parametrize("flattened", [None, 0, 1, 2])
def test_ties_on_edges_and_corners_go_to_the_same_face(
    context: moderngl.Context, corner: tuple[int, int, int], flattened: int | None
) -> None:
    atlas = make_atlas(tuple(Face))
    direction = np.array([corner], dtype=np.float64)
    if flattened is not None:
        direction[0, flattened] = 0.0
    shown, expected = shader_texels(context, atlas, direction), twin_texels(atlas, direction)
    assert shown == pytest.approx(expected, abs=2e-3)


def test_direction_beyond_five_faces_is_held_at_a_side_faces_edge(
    context: moderngl.Context,
) -> None:
    faces = (Face.N, Face.E, Face.S, Face.W, Face.C)
    atlas = make_atlas(faces)
    texel = shader_texels(context, atlas, np.array([[1.0, 0.0, -2.0], [0.0, 0.0, -1.0]]))
    x, y = atlas.face_centres()[Face.N]
    assert texel[0] == pytest.approx((x, y - 0.5 * SIZE), abs=2e-3)
    assert np.isfinite(texel).all()
