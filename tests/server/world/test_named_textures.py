"""Textures by name: the same bytes everywhere, without seams, in no time the second time."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from catoptra_server.world.named_textures import (
    NAMED_TEXTURES,
    SIDE_PX,
    load_named_texture,
    make_texture,
)


@pytest.mark.parametrize("name", NAMED_TEXTURES)
def test_texture_has_no_seam_where_tiles_meet(name: str) -> None:
    image = make_texture(name).astype(np.float64)
    for axis in (0, 1):
        steps = np.abs(np.roll(image, -1, axis) - image).mean(axis=2 - axis).mean(axis=-1)
        # The seam is a step as others are: a line of mortar is the largest.
        assert steps[-1] <= 1.5 * np.quantile(steps, 0.9)


def test_textures_have_the_same_bytes_on_every_processor() -> None:
    content = b"".join(make_texture(name).tobytes() for name in NAMED_TEXTURES)
    assert hashlib.sha256(content).hexdigest()[:16] == "edcc585d762ae391"


def test_texture_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first = load_named_texture("plaster")
    monkeypatch.setattr("catoptra_server.world.named_textures.make_texture", None)
    second = load_named_texture("plaster")
    assert first.shape == (SIDE_PX, SIDE_PX, 3)
    np.testing.assert_array_equal(first, second)
