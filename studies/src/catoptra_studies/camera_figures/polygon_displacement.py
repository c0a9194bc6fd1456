"""Displacement of the image by a mirror mesh, measured in float64.

The direction that a covered pixel looks up is projected by the camera model: the distance between
that projection and the pixel is the error.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_server.render.trace.mirror_mesh_rays import mirror_mesh_directions
from catoptra_server.scene.mirror_mesh import Tessellation

# A polygon may look up directions beyond the rim. They are projected by the same mirror with a
# wider rim, up to this fraction of the angle at which its image radius goes to infinity.
_ASYMPTOTE_FRACTION = 0.999


@dataclass(frozen=True, slots=True)
class PolygonError:
    """Displacement over all pixels whose centre a polygon covers."""

    tessellation: Tessellation
    rms_px: float
    max_px: float

    coverage: float
    """Fraction of the mirror's disc that the polygons cover."""


def measure_polygon_error(camera: OmniCamera, tessellation: Tessellation) -> PolygonError:
    """Measure the displacement by one mesh in a camera's image."""
    pixels = pixel_sample_positions(camera)[:, :, 0]
    directions, is_covered = mirror_mesh_directions(camera, tessellation, pixels)
    error_px, is_valid = displacement_px(camera, pixels, directions)
    _, is_on_disc = direction_from_pixel(camera, pixels)
    errors_px = error_px[is_covered & is_valid]
    return PolygonError(
        tessellation=tessellation,
        rms_px=float(np.sqrt(np.mean(np.square(errors_px)))),
        max_px=float(errors_px.max()),
        coverage=float(is_covered.sum() / is_on_disc.sum()),
    )


def exact_model_error_px(camera: OmniCamera) -> float:
    """Largest error where the camera model is evaluated in every pixel.

    Trace casts rays in float32, so their directions are rounded; the model itself is float64.
    """
    pixels = pixel_sample_positions(camera)[:, :, 0]
    directions, is_on_disc = direction_from_pixel(camera, pixels)
    rounded = directions.astype(np.float32).astype(np.float64)
    error_px, is_valid = displacement_px(camera, pixels, rounded)
    return float(error_px[is_on_disc & is_valid].max())


def displacement_px(camera: OmniCamera, pixels: Floats, directions: Floats) -> tuple[Floats, Bools]:
    """Distance between pixels and the projections of the directions shown there.

    Args:
        camera: Camera of the image.
        pixels: (..., 2) positions in the image.
        directions: (..., 3) directions looked up at these positions, in the mirror frame.

    Returns:
        (...) distances, and the mask of directions that have a projection.
    """
    # At 89 degrees of theta/2 even a mirror without asymptote ends; tan grows without limit there.
    t_limit = min(camera.projection.t_limit, math.tan(math.radians(89.0)))
    wide = dataclasses.replace(camera, rim_rad=_ASYMPTOTE_FRACTION * 2.0 * math.atan(t_limit))
    projections, is_valid = pixel_from_direction(wide, directions)
    return np.linalg.norm(projections - pixels, axis=-1), is_valid


def displacement_map(camera: OmniCamera, tessellation: Tessellation) -> Floats:
    """(h, w) displacement of each pixel's content in pixels; nan where no polygon is."""
    pixels = pixel_sample_positions(camera)[:, :, 0]
    directions, is_covered = mirror_mesh_directions(camera, tessellation, pixels)
    error_px, is_valid = displacement_px(camera, pixels, directions)
    return np.where(is_covered & is_valid, error_px, np.nan)
