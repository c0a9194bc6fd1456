"""What lens models share: axis in the centre, no fold, domains."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses.centred_lens import CentredLens, require_angle, require_radius


def test_lens_shows_its_axis_and_does_not_turn_back() -> None:
    assert (CentredLens().t_min, CentredLens().fold_rad) == (0.0, math.inf)


def test_angle_at_the_limit_is_accepted_and_beyond_it_rejected() -> None:
    require_angle(np.array([0.0, 1.0]), 1.0)
    with pytest.raises(DomainError, match="limit"):
        require_angle(np.array([0.0, 1.0 + 1e-9]), 1.0)


def test_radius_below_zero_is_rejected() -> None:
    with pytest.raises(DomainError, match="0 or more"):
        require_radius(np.array(-1.0))
