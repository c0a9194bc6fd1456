"""Hyperbolic mirror: the numbers of the paper's, and parameters of no mirror.

`tests/stability` compares its formulas with geometry in 50 digits.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors.hyperbolic import HyperbolicMirror, eq2_radius_ratio_from_t

PAPER = HyperbolicMirror(11.546, 2.321)


def t_from_degrees(degrees: float) -> float:
    return math.tan(math.radians(0.5 * degrees))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("s", 10.4984816045),
        ("kappa", 0.0475183955),
        ("xi", 0.9954941783),
        ("vertex_height_m", 0.1052871209),
        ("pinhole_distance_m", 2.321),
    ],
)
def test_constants_when_the_paper_s_are_those_of_the_table(name: str, value: float) -> None:
    assert getattr(PAPER, name) == pytest.approx(value, abs=5.1e-11)


def test_asymptote_when_the_paper_s_is_at_155_405263_degrees() -> None:
    assert math.degrees(2.0 * math.atan(PAPER.t_limit)) == pytest.approx(155.405263, abs=5e-7)


def test_radius_at_the_horizon_is_the_semi_latus_rectum() -> None:
    r, z = PAPER.surface_point(np.array(1.0))
    assert r == pytest.approx(0.2210795892, abs=5e-11)
    assert z == 0.0


@pytest.mark.parametrize(
    ("degrees", "exact", "eq2"),
    [
        (20.0, 0.175941187, 0.176326981),
        (60.0, 0.576480511, 0.577350269),
        (90.0, 1.0, 1.0),
        (100.0, 1.192888186, 1.191753593),
        (110.0, 1.431515995, 1.428148007),
        (120.0, 1.739926089, 1.732050808),
    ],
)
def test_ratio_when_of_the_table_s_angles_has_its_digits(
    degrees: float, exact: float, eq2: float
) -> None:
    t = np.array(t_from_degrees(degrees))
    assert PAPER.radius_ratio_from_t(t) == pytest.approx(exact, abs=5.1e-10)
    assert eq2_radius_ratio_from_t(t) == pytest.approx(eq2, abs=5.1e-10)


@pytest.mark.parametrize(
    ("degrees", "rim_radius", "psi_deg"),
    [
        (100.0, 0.26911498, 6.482),
        (110.0, 0.33300571, 7.765),
        (120.0, 0.42536299, 9.410),
        (135.0, 0.70310002, 13.089),
        (150.0, 2.32401056, 20.113),
    ],
)
def test_rim_when_of_the_table_s_angles_has_its_radius_and_camera_angle(
    degrees: float, rim_radius: float, psi_deg: float
) -> None:
    r, z = PAPER.surface_point(np.array(t_from_degrees(degrees)))
    assert r == pytest.approx(rim_radius, abs=5.1e-9)
    assert math.degrees(math.atan2(r, PAPER.pinhole_distance_m - z)) == pytest.approx(
        psi_deg, abs=5.1e-4
    )


def test_eq_2_when_compared_departs_most_below_the_horizon_at_60_degrees() -> None:
    t = np.tan(np.radians(np.linspace(0.0, 90.0, 901)) / 2.0)
    departure = PAPER.radius_ratio_from_t(t) - eq2_radius_ratio_from_t(t)
    assert departure.min() == pytest.approx(-0.000869, abs=1e-6)
    assert np.argmin(departure) == pytest.approx(600, abs=60)


def test_ratio_when_k_is_huge_is_eq_2() -> None:
    t = np.tan(np.radians([1.0, 60.0, 90.0, 130.0, 170.0]) / 2.0)
    mirror = HyperbolicMirror(1e9, 0.2)
    # The departure is t kappa^2 (t^2 - 1) / (1 - kappa^2 t^2), and kappa is 5e-10 here.
    np.testing.assert_allclose(mirror.radius_ratio_from_t(t), t, rtol=1e-15)


def test_image_when_only_c_changes_is_the_same() -> None:
    t = np.linspace(0.0, 2.0, 50)
    one, other = (HyperbolicMirror(11.546, c).radius_ratio_from_t(t) for c in (0.01, 100.0))
    np.testing.assert_array_equal(one, other)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.floats(2.0, 1e12, exclude_min=True), st.floats(0.0, 1e9))
def test_t_when_of_any_radius_is_finite_and_below_the_limit(k: float, ratio: float) -> None:
    mirror = HyperbolicMirror(k, 1.0)
    t = float(mirror.t_from_radius_ratio(np.array(ratio)))
    assert 0.0 <= t * mirror.kappa <= 1.0


@pytest.mark.parametrize(
    ("k", "c_m", "reason"),
    [
        *((k, 1.0, "k > 2") for k in (2.0, 1.0, -11.546, math.nan, math.inf)),
        *((11.546, c_m, "c > 0") for c_m in (0.0, -1.0, math.nan, math.inf)),
    ],
)
def test_parameters_when_of_no_mirror_are_rejected(k: float, c_m: float, reason: str) -> None:
    with pytest.raises(DomainError, match=reason):
        HyperbolicMirror(k, c_m)
