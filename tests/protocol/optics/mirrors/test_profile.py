"""Measured mirror: the profiles of a ball and of the paper's hyperboloid, and bad tables."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera_rays import near_limit_m
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, ProfileMirror, SphericalMirror
from helpers.lens_checks import radii
from helpers.mirror_checks import assert_is_mirror, make_camera


def profile_of_ball(num_knots: int) -> ProfileMirror:
    r = np.linspace(0.0, 0.028, num_knots)
    sag = np.square(r) / (0.03 + np.sqrt(0.03**2 - np.square(r)))
    return ProfileMirror(tuple(r.tolist()), tuple(sag.tolist()), 0.17)


def profile_of_paper_mirror(num_knots: int) -> ProfileMirror:
    rim = float(PAPER_MIRROR.surface_point(np.array(math.tan(math.radians(62.0))))[0])
    r = np.linspace(0.0, rim, num_knots)
    k, c = PAPER_MIRROR.k, PAPER_MIRROR.c_m
    root = np.sqrt(c * c / 4.0 * (k - 2.0) / k + np.square(r) * (0.5 * k - 1.0))
    sag = root - root[0]
    return ProfileMirror(tuple(r.tolist()), tuple(sag.tolist()), c - PAPER_MIRROR.vertex_height_m)


def test_profile_of_a_ball_reflects_as_the_ball() -> None:
    mirror, ball = profile_of_ball(200), SphericalMirror(0.03, 0.2)
    assert_is_mirror(mirror)
    theta = (10.0, 60.0, 90.0, 119.0)
    assert radii(mirror, *theta) == pytest.approx(radii(ball, *theta), rel=1e-5)
    assert mirror.pinhole_distance_m == pytest.approx(ball.pinhole_distance_m, abs=1e-5)


def test_profile_of_a_hyperboloid_is_central_but_for_its_spline() -> None:
    mirror = profile_of_paper_mirror(24)
    assert not mirror.is_central
    assert mirror.pinhole_distance_m == pytest.approx(PAPER_MIRROR.c_m, abs=1e-6)
    # A fraction of a millimetre: nothing outside the mirror is so near.
    assert near_limit_m(make_camera(mirror, 360)) < 1e-3


BAD = [
    ((0.0, 0.01, 0.02), (0.0, 1e-4, 2e-4), "4 to 512"),
    ((0.0, 0.01, 0.02, 0.03), (0.0, 1e-4, 2e-4), "as many sags"),
    ((0.0, 0.01, 0.01, 0.03), (0.0, 1e-4, 2e-4, 3e-4), "0.01 follows 0.01"),
    ((0.0, 0.01, 0.02, 0.03), (0.1, 1e-4, 2e-4, 3e-4), "starts at the vertex"),
    ((0.0, 0.01, 0.02, 0.03), (0.0, 0.005, 0.006, 0.0061), "turn back"),
]


@pytest.mark.parametrize(("r", "sag", "message"), BAD)
def test_bad_profile_is_rejected_with_the_reason(
    r: tuple[float, ...], sag: tuple[float, ...], message: str
) -> None:
    with pytest.raises(DomainError, match=message):
        ProfileMirror(r, sag, 0.17, 1.0)
