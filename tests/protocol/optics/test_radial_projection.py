"""The limit of a projection in words."""

from __future__ import annotations

from catoptra_protocol.optics.lenses import KannalaBrandtLens, OrthographicLens
from catoptra_protocol.optics.radial_camera import describe_limit


def test_limit_of_a_formula_is_an_angle() -> None:
    assert describe_limit(OrthographicLens()) == "90.000 deg"


def test_limit_by_a_fold_says_so() -> None:
    lens = KannalaBrandtLens(-0.030687, -0.003343, -0.002882, -0.000592)
    assert describe_limit(lens) == "93.279 deg, where its image radius turns back (its first fold)"
