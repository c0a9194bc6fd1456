"""Largest visible change by a loss of light: the worst of many surfaces, in encoded grey levels."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.effects.kernels.grey_levels import grey_level
from catoptra_server.effects.scene_summary import NO_SHADOW_LOSS, ShadowLoss
from catoptra_server.world.world_description import srgb_from_linear


def max_visible_loss(
    lost_radiance: Floats, remaining_radiance: Floats, *, can_be_darker: Bools
) -> ShadowLoss:
    """Radiance and colour channel that a loss changes most when encoded to sRGB.

    Args:
        lost_radiance: (n, 3) linear radiance that each surface loses.
        remaining_radiance: (n, 3) radiance that remains.
        can_be_darker: (n,) surfaces whose texture may scale both by any factor below one.
    """
    if not lost_radiance.any():
        return NO_SHADOW_LOSS
    lost, remaining, change = _scale_to_white(lost_radiance, remaining_radiance, can_be_darker)
    worst = np.unravel_index(int(np.argmax(change)), change.shape)
    return ShadowLoss(float(lost[worst]), float(remaining[worst]))


def visible_losses(
    lost_radiance: Floats, remaining_radiance: Floats, *, can_be_darker: Bools
) -> Floats:
    """(n,) largest changes of the surfaces' channels, grey levels; arguments as above."""
    change = _scale_to_white(lost_radiance, remaining_radiance, can_be_darker)[2]
    levels: Floats = 255.0 * change.max(axis=1)
    return levels


def _scale_to_white(
    lost_radiance: Floats, remaining_radiance: Floats, can_be_darker: Bools
) -> tuple[Floats, Floats, Floats]:
    """(n, 3) lost and remaining radiance at the scale that shows most, and encoded changes."""
    # Above white a loss is clipped away: of all scales of a textured surface, the one that just
    # reaches white loses most.
    factor = np.where(
        can_be_darker[:, None], 1.0 / np.maximum(lost_radiance + remaining_radiance, 1.0), 1.0
    )
    lost_radiance, remaining_radiance = factor * lost_radiance, factor * remaining_radiance
    # Encoded, not linear: sRGB is 13 times as steep in the dark as at white, so the largest linear
    # loss is rarely the largest visible one.
    change = _encode_srgb(lost_radiance + remaining_radiance) - _encode_srgb(remaining_radiance)
    return lost_radiance, remaining_radiance, change


def grey_level_change(loss: ShadowLoss) -> float:
    """Change of the encoded image by a loss, grey levels."""
    return grey_level(loss.remaining_radiance + loss.lost_radiance) - grey_level(
        loss.remaining_radiance
    )


def _encode_srgb(radiance: Floats) -> Floats:
    encoded: Floats = srgb_from_linear(np.minimum(radiance, 1.0))
    return encoded
