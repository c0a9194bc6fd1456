"""The mirrors' surfaces: scales from a micrometre to 1e9 m, vertex, 90-degree circle, far out."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Floats


def _hyperbolic(k: float, c_m: float, t: float) -> tuple[Floats, Floats]:
    return HyperbolicMirror(k, c_m).surface_point(np.array(t))


def _parabolic(horizon_m: float, t: float) -> tuple[Floats, Floats]:
    return ParabolicMirror(horizon_m).surface_point(np.array(t))


SUBJECTS = {"hyperbolic_surface": _hyperbolic, "parabolic_surface": _parabolic}
