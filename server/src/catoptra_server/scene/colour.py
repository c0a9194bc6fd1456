"""sRGB and linear light. Source: IEC 61966-2-1."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats, require_domain


def linear_from_srgb(encoded: Floats) -> Floats:
    """Linear light of encoded values, both in [0, 1]."""
    encoded = np.asarray(encoded, dtype=np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


@np.errstate(under="ignore")  # an underflow is black
def srgb_from_linear(linear: Floats) -> Floats:
    """Encoded values of linear light; light outside [0, 1] is clipped, as by a sensor.

    Raises:
        DomainError: An element is not a number; the text names the element.
    """
    require_domain(~np.isnan(linear), linear, "light is a number")
    # NaN passes a clip silently and would become an arbitrary grey: rejected above.
    linear = np.clip(np.asarray(linear, dtype=np.float64), 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
