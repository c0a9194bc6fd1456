"""How far from its place a picture shows things: the measure of every part of the bound."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class GeometricError:
    """Displacement in the image, and the same as an angle at the effective viewpoint.

    max: no place of the image is farther off. rms: over the image, each of its places alike.
    """

    max_px: float
    rms_px: float
    max_deg: float
    rms_deg: float


def sum_errors(errors: Iterable[GeometricError]) -> GeometricError:
    """Return what errors come to together: the largest add up, independent ones in squares."""
    every = tuple(errors)
    return GeometricError(
        max_px=math.fsum(error.max_px for error in every),
        rms_px=math.hypot(*(error.rms_px for error in every)),
        max_deg=math.fsum(error.max_deg for error in every),
        rms_deg=math.hypot(*(error.rms_deg for error in every)),
    )


def apply_floor(error: GeometricError, floor: GeometricError) -> GeometricError:
    """Return an error whose largest values are no smaller than another's; its rms stays."""
    return GeometricError(
        max_px=max(error.max_px, floor.max_px),
        rms_px=error.rms_px,
        max_deg=max(error.max_deg, floor.max_deg),
        rms_deg=error.rms_deg,
    )
