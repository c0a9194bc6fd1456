"""The lookup map: atlas coordinates of every sample of the mirror's image.

The map never changes, so it is computed once, in float64 by the camera model, and rounded to
float32 only as a position between texels: at a texel a pixel an error of 2^-25 atlas widths is less
than a thousandth of a pixel up to 4096 px. A shader that evaluates the model in float32 is off by
more where such an image comes close to a mirror's asymptote, and takes up to half as long again on
llvmpipe. No mirror needs a shader of its own.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_server.render.projection.atlas import Atlas

# Coordinate of a sample that does not see the mirror; shaders test for a negative value.
OUTSIDE_MIRROR = -1.0
# Samples of one batch: intermediate float64 values stay in the processor's cache.
_SAMPLES_PER_BATCH = 2**16


def compute_lookup_map(camera: OmniCamera, atlas: Atlas, samples: int) -> npt.NDArray[np.float32]:
    """Atlas coordinates of a grid of samples x samples in each pixel.

    Row and column r of the array belong to sample r of the grid that pixel_sample_positions has.

    Returns:
        (height samples, width samples, 2) float32 coordinates over the atlas' size, or
            OUTSIDE_MIRROR.
    """
    columns = (np.arange(camera.width_px * samples) + 0.5) / samples
    rows = (np.arange(camera.height_px * samples) + 0.5) / samples
    coordinates = np.empty((len(rows), len(columns), 2), dtype=np.float32)
    batch_rows = max(1, _SAMPLES_PER_BATCH // len(columns))
    # In batches of rows: all float64 directions of a 4096 px image at 4 x 4 samples would take 6
    # GB.
    for first in range(0, len(rows), batch_rows):
        batch = slice(first, first + batch_rows)
        coordinates[batch] = atlas_coordinates(
            camera, atlas, np.stack(np.meshgrid(columns, rows[batch]), axis=-1)
        )
    return coordinates


def atlas_coordinates(camera: OmniCamera, atlas: Atlas, pixels: Floats) -> npt.NDArray[np.float32]:
    """Atlas coordinates of pixel positions, or OUTSIDE_MIRROR.

    Args:
        camera: Camera model.
        atlas: Atlas that the coordinates refer to.
        pixels: (..., 2) pixel positions.

    Returns:
        (..., 2) float32 coordinates in units of the atlas' width and height.
    """
    directions, on_mirror = direction_from_pixel(camera, pixels)
    texels = atlas.texels_from_direction(directions)
    coordinates = np.where(
        on_mirror[..., None], texels / (atlas.width, atlas.height), OUTSIDE_MIRROR
    )
    return coordinates.astype(np.float32)
