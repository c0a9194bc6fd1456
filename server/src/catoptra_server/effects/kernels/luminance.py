"""Mean luminance of all pixels that show anything, for auto-exposure and scattering dust."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.effects.effect import Real

# Rec. 709, for linear red, green, blue.
LUMINANCE_WEIGHTS = (0.2126, 0.7152, 0.0722)


def mean_luminance(image: npt.NDArray[Real], camera: RadialCamera) -> float:
    """Mean luminance of the pixels that a mirror or lens shows anything in."""
    # Summed in float64 for any image, so the gain of a float32 image is that of its reference.
    colours = image.sum(axis=(0, 1), dtype=np.float64)
    return float(colours @ LUMINANCE_WEIGHTS) / max(count_valid_pixels(camera), 1)


@lru_cache(maxsize=16)
def count_valid_pixels(camera: RadialCamera) -> int:
    """Number of pixels whose centre has a direction; all others are black."""
    return int(camera.direction_from_pixel(pixel_sample_positions(camera))[1].sum())
