"""WoodScape lens: r = k1 theta + k2 theta^2 + k3 theta^3 + k4 theta^4, in pixels.

Source: Yogamani et al., WoodScape, ICCV 2019, `radial_poly` of its calibration files. The unit is
the pixel of the calibrated image, so the scale is 1 at that size. Domain: 0 to the first fold.
"""

from __future__ import annotations

from catoptra_protocol.optics.lenses.angle_polynomial import AnglePolynomial, PolynomialLens
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class WoodScapeLens(PolynomialLens):
    """Lens by a polynomial of the angle, in pixels."""

    k1: float
    """Pixels per radian on the axis, > 0."""
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0

    @property
    def _polynomial(self) -> AnglePolynomial:
        return AnglePolynomial((self.k1, self.k2, self.k3, self.k4))
