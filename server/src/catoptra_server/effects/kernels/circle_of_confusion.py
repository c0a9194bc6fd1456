"""Aperture of a lens, and the disc to which the lens spreads a point: by range, at image radii.

One rational function serves lenses behind a mirror (`lens_blur`) and those without (`thin_lens`).
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass

# Guards the division for objects that reach into the mirror; no visible point comes so near. The
# kernel's stage has the same constant.
_MIN_DENOMINATOR = 1e-6


@dataclass(frozen=True, slots=True)
class Aperture:
    """Lens and sensor geometry that determine the depth of field."""

    f_number: float
    """Focal length over diameter of the aperture."""
    pixel_pitch_m: float
    """Distance between the centres of adjacent pixels."""
    focus_distance_m: float
    """Depth of sharp points from the pinhole; 0: the focus whose largest disc of infinity is
    smallest, which without a mirror is infinity itself."""


@dataclass(frozen=True, slots=True, eq=False)
class CircleOfConfusion:
    """Signed disc diameter as a function of the range D from the effective viewpoint.

    d(D) = infinity_diameter_px + near_px / (power_per_m D + offset); arrays broadcast. A negative
    diameter is that of a point behind the focus.
    """

    infinity_diameter_px: Floats
    near_px: Floats
    power_per_m: Floats
    offset: Floats

    def near_term_px(self, range_m: Floats) -> Floats:
        """Difference of the signed diameter from that at infinity, 0 or more, px."""
        denominator = np.maximum(self.power_per_m * range_m + self.offset, _MIN_DENOMINATOR)
        term: Floats = self.near_px / denominator
        return term

    def diameter_px(self, range_m: Floats) -> Floats:
        """Disc diameter of points at a range; inf is allowed."""
        diameter: Floats = np.abs(self.infinity_diameter_px + self.near_term_px(range_m))
        return diameter
