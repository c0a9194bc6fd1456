"""How far a picture changes where light is taken from surfaces: the worst of all, encoded."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.effects.kernels.grey_levels import grey_level
from catoptra_server.effects.scene_summary import NO_SHADOW_LOSS, ShadowLoss
from catoptra_server.scene.colour import srgb_from_linear


def max_visible_loss(
    lost_radiance: Floats, remaining_radiance: Floats, *, can_be_darker: Bools
) -> ShadowLoss:
    """Return the row and colour of (n, 3) radiance that a loss changes most when encoded.

    Where a texture can make it darker (n,), the change is greatest with what just reaches white.
    """
    if not lost_radiance.any():
        return NO_SHADOW_LOSS
    factor = np.where(
        can_be_darker[:, None], 1.0 / np.maximum(lost_radiance + remaining_radiance, 1.0), 1.0
    )
    lost_radiance, remaining_radiance = factor * lost_radiance, factor * remaining_radiance
    change = _encode_srgb(lost_radiance + remaining_radiance) - _encode_srgb(remaining_radiance)
    worst = np.unravel_index(int(np.argmax(change)), change.shape)
    return ShadowLoss(float(lost_radiance[worst]), float(remaining_radiance[worst]))


def grey_level_change(shade: ShadowLoss) -> float:
    """Return by how many grey levels a loss changes a picture."""
    return grey_level(shade.remaining_radiance + shade.lost_radiance) - grey_level(
        shade.remaining_radiance
    )


def _encode_srgb(radiance: Floats) -> Floats:
    encoded: Floats = srgb_from_linear(np.minimum(radiance, 1.0))
    return encoded
