"""The padded texture against its float64 twin."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from catoptra_server.render.trace.padded_texture import PaddedTexture
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.shading import sample_texture


def twin_differences(texture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Differences between the padded texture and the reference at (n, 2) float32 coordinates."""
    uv = uv.astype(np.float32)
    value = PaddedTexture.from_image(texture).sample(uv[:, 0], uv[:, 1]).T
    return np.abs(value - sample_texture(linear_from_srgb(texture / 255.0), uv.astype(np.float64)))


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (7, 1), (2, 2), (16, 9)])
def test_texture_when_looked_up_anywhere_is_its_twin(shape: tuple[int, int]) -> None:
    random = np.random.default_rng(1)
    texture = random.integers(0, 256, (*shape, 3), dtype=np.uint8)
    uv = random.uniform(-3.0, 3.0, (2000, 2))
    # float32 rounds a coordinate of 3 to 2e-7, 4e-6 of a texel here; contrast is 1 at most.
    assert twin_differences(texture, uv).max() < 1e-5


@pytest.mark.parametrize("edge", [0.0, 1.0, -1.0, 1.0 - 6e-8, -1e-9, 1e-9, 0.5])
def test_texture_when_at_a_border_is_its_twin(edge: float) -> None:
    texture = np.random.default_rng(2).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    assert (
        twin_differences(texture, np.array([[edge, 0.3], [0.3, edge], [edge, edge]])).max() < 1e-5
    )


def test_texture_takes_at_most_twice_its_linear_texels() -> None:
    image = np.zeros((1000, 1000, 3), dtype=np.uint8)
    tracemalloc.start()
    try:
        PaddedTexture.from_image(image)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 2 * 12 * 1000 * 1000


def test_texels_of_all_bytes_are_those_of_the_formula() -> None:
    image = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, axis=2)
    texels = PaddedTexture.from_image(image).texels.reshape(3, 18, 18)[:, 1:-1, 1:-1]
    expected = linear_from_srgb(image / 255.0).astype(np.float32)
    np.testing.assert_array_equal(texels.transpose(1, 2, 0), expected)
