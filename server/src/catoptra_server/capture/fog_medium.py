"""Fog between mirror and surfaces: Koschmieder's law, in float64.

L' = L exp(-beta D) + A (1 - exp(-beta D)), D the range, beta the extinction per metre, A the
airlight, the same in all directions. What is infinitely far away has the colour of the airlight.
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class FogMedium:
    """Homogeneous fog of one density and colour."""

    density_per_m: float
    """Extinction beta; above 0."""
    airlight: tuple[float, float, float]
    """Linear radiance of an infinite depth of fog."""

    @np.errstate(under="ignore")  # exp of a large optical depth is 0, as intended
    def transmittance(self, range_m: Floats) -> Floats:
        """(...) fraction of light that passes (...) ranges, metres or inf."""
        return np.asarray(np.exp(-self.density_per_m * range_m))

    def mix(self, radiance: Floats, range_m: Floats) -> Floats:
        """(..., 3) linear radiance behind fog, of radiance at (...) ranges, metres or inf."""
        transmittance = self.transmittance(range_m)[..., None]
        mixed: Floats = radiance * transmittance + np.asarray(self.airlight) * (1.0 - transmittance)
        return mixed
