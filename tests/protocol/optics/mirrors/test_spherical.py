"""Spherical mirror: reflection, viewpoint, outline."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera_rays import near_limit_m
from catoptra_protocol.optics.mirrors import SphericalMirror
from helpers.mirror_checks import assert_is_mirror, make_camera

BALL = SphericalMirror(0.03, 0.2)


@pytest.mark.parametrize(
    "mirror", [BALL, SphericalMirror(0.5, 0.6, 1.5), SphericalMirror(1e-3, 5.0)]
)
def test_mirror_reflects(mirror: SphericalMirror) -> None:
    assert_is_mirror(mirror)


def test_ball_s_viewpoint_and_near_limit_are_those_of_the_reference() -> None:
    # 22.5 mm from the centre towards the camera; 7.5 mm of miss; 1.4 m at a rim of 180 px.
    assert 0.2 - BALL.pinhole_distance_m == pytest.approx(0.0225, abs=1e-4)
    camera = make_camera(BALL, 360)
    theta = np.linspace(0.01, BALL.rim_rad, 99)
    assert BALL.largest_miss_m(np.tan(0.5 * theta)).max() == pytest.approx(7.5e-3, abs=5e-5)
    assert near_limit_m(camera) == pytest.approx(1.40, abs=0.01)


def test_grazing_ray_ends_the_ball() -> None:
    limit = math.degrees(math.pi - math.asin(0.03 / 0.2))
    with pytest.raises(DomainError, match=f"at most {limit:.2f}"):
        SphericalMirror(0.03, 0.2, math.radians(limit + 0.1))
    SphericalMirror(0.03, 0.2, math.radians(limit - 0.1))


@pytest.mark.parametrize(
    "parameters", [(0.0, 0.2), (0.03, 0.03), (math.nan, 1.0), (0.03, math.inf)]
)
def test_impossible_ball_is_rejected(parameters: tuple[float, float]) -> None:
    with pytest.raises(DomainError):
        SphericalMirror(*parameters)
