"""What mirrors without a viewpoint share: rims, domains, the viewpoint's depth."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import EquiangularMirror, SphericalMirror


def test_mirror_is_not_central_and_does_not_fold() -> None:
    mirror = SphericalMirror(0.03, 0.2)
    assert not mirror.is_central
    assert math.isinf(mirror.fold_rad)


def test_image_radius_beyond_the_rim_shows_nothing() -> None:
    mirror = SphericalMirror(0.03, 0.2)
    rim = float(mirror.radius_ratio_from_t(np.array(math.tan(0.5 * mirror.rim_rad))))
    t = mirror.t_from_radius_ratio(np.array([rim, rim * 1.001]))
    assert 2.0 * math.atan(t[0]) == pytest.approx(mirror.rim_rad)
    assert math.isinf(t[1])


@pytest.mark.parametrize("rim_deg", [0.0, 170.0, math.nan])
def test_rim_beyond_the_reach_is_rejected_with_both_ends(rim_deg: float) -> None:
    with pytest.raises(DomainError, match=r"rim"):
        EquiangularMirror(3.0, 0.1, math.radians(rim_deg))
