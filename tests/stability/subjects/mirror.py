"""Mirror projections: image radius of an incidence angle, the inverse and the slope."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.numerics import Floats
from stability.catalogue import Subject


def _subject(method: str, of: str, number: type[np.floating] = np.float64) -> Subject:
    """Method of a mirror with this k, called with one number of a float type."""

    def subject(k: float, **given: float) -> Floats:
        value: Floats = getattr(HyperbolicMirror(k, 0.2), method)(np.array(given[of], number))
        assert value.dtype == number
        return value

    return subject


SUBJECTS = {
    "radius_from_incidence": _subject("radius_ratio_from_t", "t"),
    "incidence_from_radius": _subject("t_from_radius_ratio", "ratio"),
    "magnification": _subject("radius_ratio_slope", "t"),
}
IN_FLOAT32 = {
    "radius_from_incidence": _subject("radius_ratio_from_t", "t", np.float32),
    "incidence_from_radius": _subject("t_from_radius_ratio", "ratio", np.float32),
    "magnification": _subject("radius_ratio_slope", "t", np.float32),
}
