"""What all lens models share: the image's centre shows the axis, and most never turn back."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats, require_domain
from catoptra_protocol.optics.radial_camera import NO_FOLD

ANGLE_SLACK = 1e-12
"""Part by which an angle's tangent may be above the limit's, which is a rounded number."""


class CentredLens:
    """Base of the lenses."""

    __slots__ = ()

    @property
    def t_min(self) -> float:
        """0: the image's centre shows the axis."""
        return 0.0

    @property
    def fold_rad(self) -> float:
        """Infinity: the image radius grows up to the limit."""
        return NO_FOLD


def require_angle(t: npt.NDArray[np.floating], t_limit: float) -> None:
    """Raise DomainError unless every t = tan(theta / 2) is that of an angle within a limit."""
    expected = f"an angle needs 0 <= t = tan(theta / 2) <= {t_limit!r}, the lens's limit"
    require_domain((t >= 0.0) & (t <= t_limit * (1.0 + ANGLE_SLACK)), t, expected)


def require_radius(ratio: Floats) -> None:
    """Raise DomainError unless every image radius is 0 or more."""
    require_domain(ratio >= 0.0, ratio, "an image radius is 0 or more")
