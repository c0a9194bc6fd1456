"""face.vert: position of a scene vertex in a cell of the atlas, against the float64 cube."""

from __future__ import annotations

import math

import moderngl
import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, face_from_direction
from catoptra_protocol.optics.transforms import rotation_from_rpy
from catoptra_server.render.projection.atlas import GUARD_TEXELS, AtlasCell, pack_atlas
from catoptra_server.render.raster.device import (
    SPLIT_FORMAT,
    load_source,
    set_uniform,
    split_positions,
)
from helpers.worlds import regions_of_size

ATLAS = pack_atlas(regions_of_size(math.pi - 1e-3, 512), guard_texels=GUARD_TEXELS, max_texels=4096)
TURN = rotation_from_rpy(0.02, -0.03, 0.3)


def clip_positions(
    context: moderngl.Context,
    cell: AtlasCell,
    vertices: np.ndarray,
    viewpoint: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    """Clip positions (n, 4) of (n, 3) vertices around a viewpoint, as computed by the shader."""
    program = context.program(vertex_shader=load_source("face.vert"), varyings=["gl_Position"])
    split_viewpoint = split_positions(np.array(viewpoint))
    set_uniform(program, "viewpoint", split_viewpoint[:3])
    set_uniform(program, "viewpoint_rest", split_viewpoint[3:])
    set_uniform(program, "clip_from_scene", (cell.clip_from_mirror @ TURN.T).T)
    places = context.buffer(split_positions(vertices + viewpoint).tobytes())
    out = context.buffer(reserve=16 * len(vertices))
    array = context.vertex_array(program, [(places, SPLIT_FORMAT, "position", "position_rest")])
    # A context without a window draws nothing, not even into a buffer, without a target.
    context.simple_framebuffer((1, 1)).use()
    array.transform(out, moderngl.POINTS, vertices=len(vertices))
    return np.frombuffer(out.read(), dtype=np.float32).reshape(-1, 4).astype(np.float64)


def around(scale_m: float, count: int = 4000) -> np.ndarray:
    values = np.random.default_rng(9).normal(size=(count, 3))
    values *= scale_m / np.linalg.norm(values, axis=-1, keepdims=True)
    return values.astype(np.float32).astype(np.float64)


@pytest.mark.parametrize("cell", ATLAS.cells, ids=lambda cell: cell.region.face.name)
@pytest.mark.parametrize(
    ("scale_m", "viewpoint"),
    [
        (2e-3, (0.0, 0.0, 0.0)),
        (1.0, (0.0, 0.0, 0.0)),
        (1e4, (0.0, 0.0, 0.0)),
        # A hundred kilometres from the scene's centre, two centimetres from a thing.
        (2e-2, (8.1e4, -5.7e4, 12.3)),
    ],
)
def test_vertex_near_and_far_lands_on_its_texel(
    context: moderngl.Context,
    cell: AtlasCell,
    scale_m: float,
    viewpoint: tuple[float, float, float],
) -> None:
    vertices = around(scale_m)
    mirror = vertices @ TURN
    own = face_from_direction(mirror) == cell.region.face
    clip = clip_positions(context, cell, vertices, viewpoint)[own]
    size, corner = np.array((cell.width, cell.height)), np.array((cell.x, cell.y))
    texels = corner + 0.5 * (clip[:, :2] / clip[:, 3:] + 1.0) * size
    expected = ATLAS.texels_from_direction(mirror[own])
    # A dozen float32 operations on the half of 516 texels, whatever the distance.
    assert np.abs(texels - expected).max() < 12 * 258 * 2.0**-24


@pytest.mark.parametrize("cell", ATLAS.cells[:2], ids=lambda cell: cell.region.face.name)
def test_vertex_at_the_viewpoint_or_behind_it_is_clipped_not_infinite(
    context: moderngl.Context, cell: AtlasCell
) -> None:
    ahead = TURN @ MIRROR_FROM_FACE_ROTATIONS[cell.region.face][:, 0]
    clip = clip_positions(context, cell, np.stack((np.zeros(3), -ahead, -1e30 * ahead)))
    assert np.isfinite(clip).all()
    assert (clip[:, 3] <= 0.0).all()
