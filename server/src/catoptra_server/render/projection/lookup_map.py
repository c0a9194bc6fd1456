"""Where every sample of the mirror's picture looks in the atlas. Knows no GL.

It never changes, so it is computed once, in float64 by the camera's law, and rounded to float32
only as a place between texels: at a texel a pixel an error of 2^-25 atlas widths is less than a
thousandth of a pixel up to 4096 px. A shader that evaluates the law in float32 is off by more where
such an image comes close to a mirror's asymptote, and takes up to half as long again on llvmpipe.
No mirror needs a shader of its own.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_server.render.projection.atlas import Atlas

# What a sample looks up that sees no mirror.
OUTSIDE_MIRROR = -1.0
# Rows at a time: the float64 values between stay in the processor's cache.
_SAMPLES_PER_BATCH = 2**16


def compute_lookup_map(camera: OmniCamera, atlas: Atlas, samples: int) -> npt.NDArray[np.float32]:
    """Return (height samples, width samples, 2): places over the atlas' size, or NOWHERE.

    Row and column r of the array are those of a grid of samples x samples in each pixel, as
    pixel_sample_positions has them.
    """
    columns = (np.arange(camera.width_px * samples) + 0.5) / samples
    rows = (np.arange(camera.height_px * samples) + 0.5) / samples
    places = np.empty((len(rows), len(columns), 2), dtype=np.float32)
    at_once = max(1, _SAMPLES_PER_BATCH // len(columns))
    for first in range(0, len(rows), at_once):
        part = slice(first, first + at_once)
        places[part] = atlas_coordinates(
            camera, atlas, np.stack(np.meshgrid(columns, rows[part]), axis=-1)
        )
    return places


def atlas_coordinates(camera: OmniCamera, atlas: Atlas, pixels: Floats) -> npt.NDArray[np.float32]:
    """Return the (..., 2) places that (..., 2) pixels look up, over the atlas' size, or NOWHERE."""
    directions, on_mirror = direction_from_pixel(camera, pixels)
    texels = atlas.texels_from_direction(directions)
    places = np.where(on_mirror[..., None], texels / (atlas.width, atlas.height), OUTSIDE_MIRROR)
    return places.astype(np.float32)
