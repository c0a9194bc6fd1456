"""Hyperbolic mirror against derived numbers and against geometry in 50 digits.

The reference is independent of the product's formulas: it intersects Eq. 1 with a scene ray aimed
at the viewpoint and projects the mirror point through the pinhole.
"""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors.hyperbolic import HyperbolicMirror, eq2_radius_ratio_from_t

PAPER = HyperbolicMirror(11.546, 2.321)
EPS = float(np.finfo(np.float64).eps)
SMALLEST_KS = (math.nextafter(2.0, 3.0), 2.0 + 1e-12, 2.0001)
KS = (*SMALLEST_KS, 3.0, 11.546, 1e3, 1e9, 1e15)


def t_from_degrees(degrees: float) -> float:
    return math.tan(math.radians(0.5 * degrees))


def edge_case_ts(mirror: HyperbolicMirror) -> list[float]:
    """t at the axis, the horizon and its neighbours, the rim, and before the asymptote."""
    limit = mirror.t_limit
    inside = [0.0, 1e-250, 1e-12, 1e-3, 0.5, math.nextafter(1.0, 0.0), 1.0, t_from_degrees(120.0)]
    outside = [limit * (1.0 - 1e-3), limit * (1.0 - 1e-9), math.nextafter(limit, 0.0)]
    return [t for t in inside if t < limit] + outside


def exact_mirror_point(mirror: HyperbolicMirror, t: float) -> tuple[mpmath.mpf, mpmath.mpf]:
    """(r, z) where a ray of t, aimed at the viewpoint, meets the sheet of Eq. 1."""
    k, c, tangent = mpmath.mpf(mirror.k), mpmath.mpf(mirror.c_m), mpmath.mpf(t)
    sine, cosine = 2 * tangent / (1 + tangent**2), (1 - tangent**2) / (1 + tangent**2)
    a, b, constant = cosine**2 - sine**2 * (k / 2 - 1), -c * cosine, c**2 / (2 * k)
    way = 2 * constant / (-b + mpmath.sqrt(b**2 - 4 * a * constant))
    return way * sine, way * cosine


def exact_ratio(mirror: HyperbolicMirror, t: float) -> mpmath.mpf:
    """r_i / h by projection through the pinhole at (0, c)."""
    r, z = exact_mirror_point(mirror, t)
    k = mpmath.mpf(mirror.k)
    return mpmath.sqrt(k * (k - 2)) * r / (mpmath.mpf(mirror.c_m) - z)


def relative_error(value: float, exact: mpmath.mpf) -> float:
    return float(abs(mpmath.mpf(value) - exact) / exact) if exact else abs(value)


def condition_number(mirror: HyperbolicMirror, t: float) -> float:
    """Amplification of the relative error of t in the ratio: 1 / (1 - kappa t)."""
    return 1.0 / (1.0 - mirror.kappa * t)


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


@pytest.mark.parametrize("k", KS)
def test_ratio_in_hard_cases_is_that_of_50_digits(k: float) -> None:
    mirror = HyperbolicMirror(k, 2.321)
    with mpmath.workdps(50):
        for t in edge_case_ts(mirror):
            value = float(mirror.radius_ratio_from_t(np.array(t)))
            error = relative_error(value, exact_ratio(mirror, t))
            assert error <= 8.0 * EPS * condition_number(mirror, t), (k, t)


@pytest.mark.parametrize("k", KS)
def test_t_when_read_back_in_hard_cases_is_the_same(k: float) -> None:
    mirror = HyperbolicMirror(k, 2.321)
    for t in edge_case_ts(mirror):
        back = float(mirror.t_from_radius_ratio(mirror.radius_ratio_from_t(np.array(t))))
        assert back == pytest.approx(t, rel=16.0 * EPS, abs=0.0), (k, t)


@pytest.mark.parametrize("k", KS)
@pytest.mark.parametrize("c_m", [1e-6, 2.321, 1e6])
def test_surface_in_hard_cases_is_that_of_50_digits(k: float, c_m: float) -> None:
    mirror = HyperbolicMirror(k, c_m)
    with mpmath.workdps(50):
        for t in edge_case_ts(mirror)[:-2]:
            r, z = (float(value) for value in mirror.surface_point(np.array(t)))
            exact_r, exact_z = exact_mirror_point(mirror, t)
            scale = 1.0 / (1.0 - mirror.kappa * t * t)
            assert relative_error(r, exact_r) <= 8.0 * EPS * scale, (k, t)
            # z passes through zero at the horizon: its error is measured by the mirror's size.
            size = mpmath.hypot(exact_r, exact_z)
            assert abs(z - exact_z) <= 8.0 * EPS * scale * size, (k, t)


@pytest.mark.parametrize("k", KS)
def test_eq_1_when_put_in_at_the_surface_is_fulfilled(k: float) -> None:
    mirror = HyperbolicMirror(k, 2.321)
    for t in edge_case_ts(mirror)[:-2]:
        r, z = (float(value) for value in mirror.surface_point(np.array(t)))
        c = mirror.c_m
        squares = ((z - 0.5 * c) ** 2, r * r * (0.5 * k - 1.0), 0.25 * c * c * (k - 2.0) / k)
        # z is known to eps c, but lies nearer than that to c / 2 where the mirror is nearly flat.
        rounding = 32.0 * max(squares) + 8.0 * c * abs(z - 0.5 * c)
        scale = 1.0 / (1.0 - mirror.kappa * t * t)
        assert abs(squares[0] - squares[1] - squares[2]) <= EPS * scale * rounding, (k, t)


@pytest.mark.parametrize("k", KS[2:])
def test_ray_when_aimed_at_the_viewpoint_reflects_to_the_pinhole(k: float) -> None:
    mirror = HyperbolicMirror(k, 2.321)
    t = np.array([t for t in edge_case_ts(mirror)[:-2] if t > 1e-9])
    r, z = mirror.surface_point(t)
    normal = np.stack((-r * (0.5 * k - 1.0), z - 0.5 * mirror.c_m), axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    inward = -np.stack((r, z), axis=-1) / np.hypot(r, z)[:, None]
    reflected = inward - 2.0 * np.einsum("ij,ij->i", inward, normal)[:, None] * normal
    to_pinhole = np.stack((-r, mirror.pinhole_distance_m - z), axis=-1)
    cross = reflected[:, 0] * to_pinhole[:, 1] - reflected[:, 1] * to_pinhole[:, 0]
    sine = cross / np.hypot(*to_pinhole.T)
    # Double precision in the reflection itself; the mirror point is known better.
    np.testing.assert_allclose(sine, 0.0, atol=1e-13)


@pytest.mark.parametrize("k", [2.5, 11.546, 1e6])
def test_slope_when_compared_with_50_digit_differentiation_agrees(k: float) -> None:
    mirror = HyperbolicMirror(k, 2.321)
    with mpmath.workdps(50):
        for degrees in (1e-6, 30.0, 90.0, 100.0):
            theta = mpmath.mpf(math.radians(degrees))
            exact = mpmath.diff(lambda a: _ratio_of_theta(mirror, a), theta)
            value = float(mirror.radius_ratio_slope(np.array(float(mpmath.tan(theta / 2)))))
            assert relative_error(value, exact) < 1e-14


def _ratio_of_theta(mirror: HyperbolicMirror, theta: mpmath.mpf) -> mpmath.mpf:
    k, t = mpmath.mpf(mirror.k), mpmath.tan(theta / 2)
    s = mpmath.sqrt(k * (k - 2))
    kappa = 1 / (k - 1 + s)
    return 2 * kappa * s * t / (1 - kappa**2 * t**2)


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
