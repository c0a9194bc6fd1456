"""Natural vignetting: irradiance of the image of a scene of one radiance, relative to the axis.

A pinhole or thin lens loses cos^4 of the angle of its chief ray: a cosine for its aperture, seen
obliquely, three for the solid angle of a pixel. A wide-angle lens turns its entrance pupil towards
the ray, so that its aperture keeps its area, and only the solid angle of a pixel remains,
sin(theta) / (r dr/dtheta): 1 for an equisolid lens, whose pixels see equal solid angles. Source:
Reiss 1945; Slyusarev 1984.
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_projection import RadialProjection


def cosine_fourth(tangent: Floats) -> Floats:
    """cos^4 of angles by their tangents."""
    # 1 / (1 + tan^2)^2 needs no arctangent and has no cancellation on the axis.
    factor: Floats = (1.0 + np.square(tangent)) ** -2
    return factor


@np.errstate(divide="ignore")
def wide_angle_illumination(projection: RadialProjection, t: Floats) -> Floats:
    """Relative illumination of a wide-angle lens at t = tan(theta / 2), at most 1.

    Next to a fold, where a pixel sees an unbounded solid angle, a real lens vignettes otherwise: no
    gain above the axis's is assumed.
    """
    squared = np.square(t)
    radius, slope = projection.radius_ratio_from_t(t), projection.radius_ratio_slope(t)
    on_axis = float(projection.radius_ratio_slope(np.array(0.0)))
    sine = 2.0 * t / (1.0 + squared)
    # r / sin(theta) is 0 / 0 on the axis, where it is the slope.
    is_off_axis = t > 1e-9
    across = np.where(is_off_axis, radius / np.where(is_off_axis, sine, 1.0), on_axis)
    return np.minimum(on_axis**2 / (across * slope), 1.0)
