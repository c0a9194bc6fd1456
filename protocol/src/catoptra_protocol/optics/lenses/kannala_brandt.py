"""Kannala-Brandt lens: r = f theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8).

Source: Kannala & Brandt, PAMI 28 (2006), without its asymmetric terms: as in OpenCV's fisheye
module, Kalibr ("equidistant") and Basalt ("kb4"). Domain: 0 to the first fold of the polynomial.
Readers that divide by z, as OpenCV's does, are wrong beyond 90 degrees; here theta is the angle.
"""

from __future__ import annotations

from catoptra_protocol.optics.lenses.angle_polynomial import AnglePolynomial, PolynomialLens
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class KannalaBrandtLens(PolynomialLens):
    """Lens by an odd polynomial of the angle; the focal length is the scale."""

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0

    @property
    def _polynomial(self) -> AnglePolynomial:
        return AnglePolynomial((1.0, 0.0, self.k1, 0.0, self.k2, 0.0, self.k3, 0.0, self.k4))
