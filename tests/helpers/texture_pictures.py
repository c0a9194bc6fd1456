"""The pictures of the bundled worlds' surfaces, drawn by formulas: plaster, concrete, wood.

Run: cd tests && ../.venv/bin/python -m helpers.texture_pictures

Writes configs/worlds/textures/*.png (not bricks.png and tiles.png, which are older). Each repeats
without a seam and is grey, to be multiplied by a world's `Colour`. Contrasts are low, so that
colours are found as on plain surfaces: no texel differs from the mean by more than a quarter of its
light.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world.textures import Texture
from catoptra_server.world.world_description import srgb_from_linear
from helpers.configs import WORLDS

FOLDER = WORLDS / "textures"
SIDE_PX = 256
MEAN_GREY = 0.8
"""Mean light of the greys: a world's `Colour` is the mean colour over it."""
MAX_BYTES = 60_000


def make_noise(seed: int, half_width: int, half_height: int) -> Floats:
    """(256, 256) periodic noise of mean 0 and standard deviation 1, averaged over rectangles.

    Sums of integers: the same numbers on any machine.
    """
    values = np.random.default_rng(seed).integers(0, 256, (SIDE_PX, SIDE_PX))
    for axis, half in ((1, half_width), (0, half_height)):
        values = sum(np.roll(values, shift, axis) for shift in range(-half, half + 1))
    return (values - values.mean()) / values.std()


def draw_plaster() -> Texture:
    """Trowelled plaster: faint clouds and a little grain; 3 m."""
    light = 0.02 * make_noise(5, 14, 10) + 0.015 * make_noise(6, 3, 3) + 0.01 * make_noise(7, 0, 0)
    return make_grey(light)


def draw_concrete() -> Texture:
    """Worn concrete: stains and pores; 2 m."""
    pores = np.minimum(make_noise(9, 1, 1) + 2.2, 0.0)
    return make_grey(0.06 * make_noise(8, 17, 17) + 0.03 * make_noise(10, 0, 0) + 0.25 * pores)


def draw_wood() -> Texture:
    """Plywood, its grain along the rows; 1 m."""
    return make_grey(0.07 * make_noise(11, 60, 1) + 0.05 * make_noise(12, 90, 5))


def make_grey(light: Floats) -> Texture:
    """Grey of deviations from the mean, whose mean light is 0.8."""
    grey = 1.0 + np.clip(light, -0.24, 0.24)
    grey = MEAN_GREY * np.rint(50.0 * grey / grey.mean()) / 50.0
    return encode(np.repeat(grey[..., None], 3, axis=-1))


def encode(light: Floats) -> Texture:
    """SRGB bytes of linear light."""
    return np.rint(255.0 * srgb_from_linear(light)).astype(np.uint8)


DRAWINGS: dict[str, Callable[[], Texture]] = {
    "plaster.png": draw_plaster,
    "concrete.png": draw_concrete,
    "wood.png": draw_wood,
}


def main() -> None:
    """Write all pictures."""
    for name, draw in DRAWINGS.items():
        save_with_palette(draw(), FOLDER / name)


def save_with_palette(picture: Texture, path: Path) -> None:
    """Write a PNG of at most 256 colours by their numbers: a third of the size."""
    colours, index = np.unique(picture.reshape(-1, 3), axis=0, return_inverse=True)
    image = Image.fromarray(index.reshape(picture.shape[:2]).astype(np.uint8), mode="P")
    image.putpalette(colours.tobytes())
    image.save(path, optimize=True)


if __name__ == "__main__":
    main()
