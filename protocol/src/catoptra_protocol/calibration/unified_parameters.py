"""Cameras as unified spheres: the projections that are Mei's model, exactly.

With t = tan(theta / 2) Mei's radius is 2 t / ((1 + xi) + (xi - 1) t^2): a hyperbolic mirror has xi
= s / (k - 1) and gamma = h xi, a parabolic one and a stereographic lens have xi = 1. UCM and EUCM
with beta = 1 have xi = alpha / (1 - alpha), double spheres are unified with alpha = 0 or xi = 0.
"""

from __future__ import annotations

import math

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import (
    DoubleSphereLens,
    EnhancedUnifiedLens,
    StereographicLens,
    UnifiedLens,
)
from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class UnifiedParameters:
    """Mei's parameters of a camera."""

    xi: float
    gamma_px: float
    """Focal length of the plane behind the sphere."""
    k1: float = 0.0
    k2: float = 0.0

    @property
    def is_distorted(self) -> bool:
        """Whether the plane is distorted radially."""
        return self.k1 != 0.0 or self.k2 != 0.0

    @property
    def alpha(self) -> float:
        """Parameter of UCM, EUCM and double sphere, xi / (1 + xi)."""
        return self.xi / (1.0 + self.xi)

    @property
    def focal_length_px(self) -> float:
        """Focal length of UCM, EUCM and double sphere, gamma / (1 + xi)."""
        return self.gamma_px / (1.0 + self.xi)


def unified_parameters(camera: OmniCamera) -> UnifiedParameters:
    """Mei's parameters of a camera.

    Raises:
        DomainError: The projection is no unified sphere.
    """
    scale_px = camera.scale_px
    match camera.projection:
        case HyperbolicMirror() as mirror:
            return UnifiedParameters(mirror.xi, scale_px * mirror.xi)
        case ParabolicMirror():
            return UnifiedParameters(1.0, scale_px)
        case StereographicLens():
            return UnifiedParameters(1.0, 2.0 * scale_px)
        case UnifiedLens(xi, k1, k2):
            return UnifiedParameters(xi, scale_px, k1, k2)
        case EnhancedUnifiedLens(alpha, beta) if beta == 1.0 and alpha < 1.0:
            return _from_alpha(alpha, scale_px)
        case DoubleSphereLens(xi, alpha) if xi == 0.0:
            return _from_alpha(alpha, scale_px)
        case DoubleSphereLens(xi, alpha) if alpha == 0.0 and xi >= 0.0:
            return UnifiedParameters(xi, scale_px)
    raise DomainError(f"{type(camera.projection).__name__} is no unified sphere")


def _from_alpha(alpha: float, focal_length_px: float) -> UnifiedParameters:
    xi = alpha / (1.0 - alpha)
    assert math.isfinite(xi), "alpha is below 1"
    return UnifiedParameters(xi, focal_length_px * (1.0 + xi))
