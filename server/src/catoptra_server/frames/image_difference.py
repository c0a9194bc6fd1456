"""Difference of a picture from a reference of the same exposure, shown beside the picture."""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.renderer import Image


@dataclass(frozen=True, slots=True)
class ImageDifference:
    """Difference in encoded grey levels."""

    reference_plan: str
    """Plan of the reference in words."""
    max_levels: int
    """Largest absolute difference of a value."""
    rms_levels: float
    """Root mean square over all pixels and colours."""
    changed_fraction: float
    """Fraction of the pixels that differ in a colour."""


def append_difference(
    rgb: Image, reference: Image, reference_plan: str
) -> tuple[Image, ImageDifference]:
    """Image of twice the width, with the absolute differences to the right of the picture.

    Args:
        rgb: (h, w, 3) uint8.
        reference: Likewise, of the same exposure.
        reference_plan: Plan of the reference in words.

    Returns:
        The (h, 2 w, 3) image, read-only, and the difference in numbers.
    """
    # In uint8: the larger minus the smaller never wraps around.
    levels = np.maximum(rgb, reference) - np.minimum(rgb, reference)
    image = np.concatenate((rgb, levels), axis=1)
    image.setflags(write=False)
    squares = np.bincount(levels.ravel(), minlength=256) * np.arange(256.0) ** 2
    return image, ImageDifference(
        reference_plan,
        max_levels=int(levels.max(initial=0)),
        rms_levels=math.sqrt(float(squares.sum()) / max(1, levels.size)),
        changed_fraction=float(levels.any(axis=2).mean()),
    )
