"""Projection of a perspective camera."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.render.projection.frustum import make_lens_projection

CAMERA = PerspectiveCamera(320, 200, math.radians(100.0))


@pytest.mark.parametrize("turn", [None, MIRROR_FROM_FACE_ROTATIONS[Face.E]])
def test_projection_puts_a_direction_on_its_pixel(turn: np.ndarray[tuple[int, int]] | None) -> None:
    cell = make_lens_projection(CAMERA, 3, turn, max_texels=4096)
    pixel = np.random.default_rng(8).uniform((0.0, 0.0), (320.0, 200.0), (500, 2))
    direction, _ = CAMERA.direction_from_pixel(pixel)
    in_mirror = direction if turn is None else direction @ turn.T
    x, y, w = cell.clip_from_mirror @ in_mirror.T
    shown = 0.5 * (np.stack((x / w, y / w), axis=-1) + 1.0) * (320.0, 200.0)
    np.testing.assert_allclose(shown, pixel, atol=1e-10)


def test_samples_make_the_texture_larger() -> None:
    cell = make_lens_projection(CAMERA, 3, max_texels=960)
    assert cell.viewport == (0, 0, 960, 600)
    assert cell.cells == (cell,)


def test_texture_that_is_too_large_is_rejected_with_the_limit() -> None:
    with pytest.raises(DomainError, match="allows 959 px"):
        make_lens_projection(CAMERA, 3, max_texels=959)
