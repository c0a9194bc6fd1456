"""Angles and the few series that the rest of the law leans on. Everything broadcasts."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

TWO_PI = 2.0 * math.pi


def wrap_angle(angle_rad: float) -> float:
    """Return the angle wrapped to (-pi, pi].

    The IEEE remainder is exact, so a wrap adds no error of its own. It rounds half turns to even
    and so returns -pi for some of them; those are moved to +pi, the end of the interval that
    belongs to it.
    """
    wrapped = math.remainder(angle_rad, TWO_PI)
    return math.pi if wrapped <= -math.pi else wrapped
