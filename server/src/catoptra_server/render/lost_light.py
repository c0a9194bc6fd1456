"""How far a picture changes where light is taken from surfaces: the worst of all, encoded."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.effects.scene_summary import NO_SHADE, Shade
from catoptra_server.effects.shared.grey_levels import grey_level
from catoptra_server.scene.colour import srgb_from_linear


def greatest_loss(lost: Floats, left: Floats, *, can_be_darker: Bools) -> Shade:
    """Return the row and colour of (n, 3) radiance that a loss changes most when encoded.

    Where a texture can make it darker (n,), the change is greatest with what just reaches white.
    """
    if not lost.any():
        return NO_SHADE
    factor = np.where(can_be_darker[:, None], 1.0 / np.maximum(lost + left, 1.0), 1.0)
    lost, left = factor * lost, factor * left
    change = _encoded(lost + left) - _encoded(left)
    worst = np.unravel_index(int(np.argmax(change)), change.shape)
    return Shade(float(lost[worst]), float(left[worst]))


def change_of(shade: Shade) -> float:
    """Return by how many grey levels a loss changes a picture."""
    return grey_level(shade.left + shade.lost) - grey_level(shade.left)


def _encoded(radiance: Floats) -> Floats:
    encoded: Floats = srgb_from_linear(np.minimum(radiance, 1.0))
    return encoded
