"""Displacement of an image from the camera model: the measure of every component of an error
bound."""

from __future__ import annotations

import math
from collections.abc import Iterable

from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class GeometricError:
    """Displacement in the image, and as an angle at the effective viewpoint."""

    max_px: float
    """No pixel is displaced farther."""
    rms_px: float
    """Root mean square over the image area."""
    max_deg: float
    """No direction is displaced farther."""
    rms_deg: float
    """Root mean square over the image area."""


def sum_errors(errors: Iterable[GeometricError]) -> GeometricError:
    """Sum of errors: maxima add up, rms values of independent errors add in squares."""
    every = tuple(errors)
    return GeometricError(
        max_px=math.fsum(error.max_px for error in every),
        rms_px=math.hypot(*(error.rms_px for error in every)),
        max_deg=math.fsum(error.max_deg for error in every),
        rms_deg=math.hypot(*(error.rms_deg for error in every)),
    )


def apply_floor(error: GeometricError, floor: GeometricError) -> GeometricError:
    """Error with maxima no smaller than another's; the rms stays."""
    return GeometricError(
        max_px=max(error.max_px, floor.max_px),
        rms_px=error.rms_px,
        max_deg=max(error.max_deg, floor.max_deg),
        rms_deg=error.rms_deg,
    )
