"""Conical mirror: reflection, circle of viewpoints, apex."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import ConicalMirror
from helpers.mirror_checks import assert_is_mirror, make_camera

CONE = ConicalMirror(math.radians(45.0), 0.2, math.radians(97.4))


@pytest.mark.parametrize(
    "mirror", [CONE, ConicalMirror(math.radians(60.0), 0.1, math.radians(90.0))]
)
def test_mirror_reflects(mirror: ConicalMirror) -> None:
    assert_is_mirror(mirror)


def test_camera_and_scene_angles_differ_by_a_constant() -> None:
    psi = np.array([0.0, 0.05])
    assert CONE.reflect(psi).theta == pytest.approx(0.5 * math.pi + psi)
    assert CONE.t_min == pytest.approx(1.0)


def test_viewpoints_form_the_circle_of_the_mirrored_pinhole() -> None:
    # Radius d sin(2 alpha), depth d (1 - cos(2 alpha)) from the pinhole: each ray passes it.
    reflection = CONE.reflect(np.linspace(0.01, 0.12, 7))
    along_r, along_depth = np.sin(reflection.theta), -np.cos(reflection.theta)
    to_circle = (0.2 * math.sin(math.pi / 2) * -1.0 - reflection.r, 0.2 - reflection.depth)
    cross = to_circle[0] * along_depth - to_circle[1] * along_r
    assert cross == pytest.approx(np.zeros(7), abs=1e-15)


def test_apex_shows_no_direction() -> None:
    camera = make_camera(CONE)
    _, valid = camera.direction_from_pixel(np.array([camera.centre_px, (330.0, 320.0)]))
    assert valid.tolist() == [False, True]
    _, shown = camera.pixel_from_direction(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.3]]))
    assert not shown.any()


@pytest.mark.parametrize(
    "change", [{"half_angle_rad": 0.0}, {"apex_distance_m": 0.0}, {"rim_rad": 1.5}]
)
def test_impossible_cone_is_rejected(change: dict[str, float]) -> None:
    good = {"half_angle_rad": math.radians(45.0), "apex_distance_m": 0.2, "rim_rad": 1.6}
    ConicalMirror(**good)
    with pytest.raises(DomainError):
        ConicalMirror(**good | change)
