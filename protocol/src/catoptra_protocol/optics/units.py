"""Conversion of Unreal units (UU) to metres and radians, for `config` and `usarsim`.

Source: UnitsConverter.uc of USARSim: 250 UU per metre, 65536 UU per turn.
"""

from __future__ import annotations

import math

from catoptra_protocol.errors import DomainError

_UU_PER_METRE = 250.0
_UU_PER_RADIAN = 65536.0 / (2.0 * math.pi)


def metres_from_uu(length_uu: float) -> float:
    """Length in metres of a length in Unreal units."""
    return _require_finite(length_uu) / _UU_PER_METRE


def radians_from_uu(angle_uu: float) -> float:
    """Angle in radians of an angle in Unreal rotation units."""
    return _require_finite(angle_uu) / _UU_PER_RADIAN


def _require_finite(value_uu: float) -> float:
    """Pass a finite value through; DomainError for NaN and infinity."""
    if not math.isfinite(value_uu):
        raise DomainError(f"{value_uu!r} Unreal units are no length and no angle")
    return value_uu
