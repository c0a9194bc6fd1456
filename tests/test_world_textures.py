"""The bundled worlds' pictures: drawn by the script, small, of the colours that they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.world.world_description import linear_from_srgb
from helpers.loaded_files import load_texture
from helpers.texture_pictures import DRAWINGS, FOLDER, MAX_BYTES, MEAN_GREY


@pytest.mark.parametrize("name", DRAWINGS)
def test_file_holds_what_the_script_draws(name: str) -> None:
    np.testing.assert_array_equal(load_texture(FOLDER / name), DRAWINGS[name]())
    assert (FOLDER / name).stat().st_size < MAX_BYTES


@pytest.mark.parametrize("name", DRAWINGS)
def test_mean_light_is_that_of_the_plain_surface(name: str) -> None:
    light = linear_from_srgb(load_texture(FOLDER / name) / 255.0)
    # A hundredth of the light is a grey level.
    np.testing.assert_allclose(light.mean(axis=(0, 1)), MEAN_GREY, rtol=0.01)
    assert np.abs(light / MEAN_GREY - 1.0).max() < 0.27
