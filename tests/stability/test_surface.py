"""The mirrors' surfaces: scales from a micrometre to 1e9 m, vertex, 90-degree circle, far out."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from stability.catalogue import Case, check, load


def _hyperbolic(k: float, c_m: float, t: float) -> tuple[Floats, Floats]:
    return HyperbolicMirror(k, c_m).surface_point(np.array(t))


def _parabolic(horizon_m: float, t: float) -> tuple[Floats, Floats]:
    return ParabolicMirror(horizon_m).surface_point(np.array(t))


SUBJECTS = {"hyperbolic_surface": _hyperbolic, "parabolic_surface": _parabolic}


@pytest.mark.parametrize("case", load("surface"), ids=str)
def test_surface_when_at_a_hard_case_is_that_of_50_digits(case: Case) -> None:
    check(case, SUBJECTS)
