"""How far a polygon mirror shows things from where the exact law puts them, measured in float64.

The direction that each covered pixel looks up is sent back through the exact law: the distance
between where it belongs and where it was shown is the error. Source: optics notes, 3.2.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
    pixel_sample_positions,
)
from catoptra_server.render.trace.mirror_mesh_rays import mirror_mesh_directions
from catoptra_server.scene.mirror_mesh import Tessellation

# A polygon may show directions beyond the rim; they are placed by the law of the same mirror cut
# wider, up to this part of the way to its asymptote.
_ASYMPTOTE_FRACTION = 0.999


@dataclass(frozen=True, slots=True)
class PolygonError:
    """Displacement over the covered pixel centres; covered: their part of the rim's disc."""

    tessellation: Tessellation
    rms_px: float
    max_px: float
    coverage: float


def measure_polygon_error(camera: OmniCamera, tessellation: Tessellation) -> PolygonError:
    """Return the error of a polygon mirror in a camera's image."""
    pixels = pixel_sample_positions(camera)[:, :, 0]
    directions, covered = mirror_mesh_directions(camera, tessellation, pixels)
    error_px, known = displacement_px(camera, pixels, directions)
    _, on_disc = direction_from_pixel(camera, pixels)
    counted = error_px[covered & known]
    return PolygonError(
        tessellation=tessellation,
        rms_px=float(np.sqrt(np.mean(np.square(counted)))),
        max_px=float(counted.max()),
        coverage=float(covered.sum() / on_disc.sum()),
    )


def exact_model_error_px(camera: OmniCamera) -> float:
    """Return the largest error of the per-pixel surface: float32 rays against the float64 law."""
    pixels = pixel_sample_positions(camera)[:, :, 0]
    directions, on_disc = direction_from_pixel(camera, pixels)
    as_drawn = directions.astype(np.float32).astype(np.float64)
    error_px, known = displacement_px(camera, pixels, as_drawn)
    return float(error_px[on_disc & known].max())


def displacement_px(camera: OmniCamera, pixels: Floats, directions: Floats) -> tuple[Floats, Bools]:
    """Return (...) distances from pixels to where their directions belong, and which have one."""
    t_limit = min(camera.mirror.t_limit, math.tan(math.radians(89.0)))
    wide = dataclasses.replace(camera, rim_rad=_ASYMPTOTE_FRACTION * 2.0 * math.atan(t_limit))
    belongs_at, known = pixel_from_direction(wide, directions)
    return np.linalg.norm(belongs_at - pixels, axis=-1), known
