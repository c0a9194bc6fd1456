from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.camera import (
    direction_from_pixel,
    pixel_centres,
    pixel_from_direction,
)
from catoptra_server.effects.capture import Capture, Geometry
from catoptra_server.effects.image_law import INNER, image_law
from catoptra_server.effects.image_motion import ImageMotion
from catoptra_server.effects.image_ways import ImageWays
from catoptra_server.scene.motion import AT_REST, Twist
from helpers.worlds import omni_camera

CAMERA = omni_camera(width_px=320)
SHAPE = (CAMERA.height_px, CAMERA.width_px)
EVERY = np.arange(SHAPE[0] * SHAPE[1])
INSIDE = image_law(CAMERA).standing.reshape(-1) == INNER
DOUBLE = np.dtype(np.float64)
T_S = 1.0 / 30.0
RIGHT = Twist((0.0, 1.0, 0.0))


def ways(
    motion: tuple[Twist, ...], range_m: float = np.inf, geometry: Geometry | None = None
) -> ImageWays[np.float64]:
    everywhere = Geometry(np.full(SHAPE, range_m, np.float32), np.zeros(SHAPE, np.float32))
    capture = Capture(motion=motion, geometry=geometry or everywhere)
    return ImageWays(ImageMotion(CAMERA, capture, DOUBLE), T_S, DOUBLE)


def aside(found: ImageWays[np.float64], tau_s: float) -> np.ndarray:
    return found.to(EVERY).aside(np.array(tau_s))


def exact_aside(twist: Twist, range_m: float, tau_s: float) -> np.ndarray:
    """Return (2, h w) px to where what is at each pixel at a time was, for a turn, then a step."""
    pixels = pixel_centres(CAMERA)[..., 0, :].reshape(-1, 2)
    points = range_m * direction_from_pixel(CAMERA, pixels)[0]
    angle = twist.angular_rad_s[2] * tau_s
    turn = np.array(
        [
            [math.cos(angle), -math.sin(angle), 0.0],
            [math.sin(angle), math.cos(angle), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    before = (points - np.asarray(twist.linear_m_s) * tau_s) @ turn
    return (pixel_from_direction(CAMERA, before)[0] - pixels).T


@pytest.mark.parametrize("turn_deg_s", [60.0, 180.0, 300.0])
def test_way_when_turning_is_an_arc(turn_deg_s: float) -> None:
    twist = Twist(angular_rad_s=(0.0, 0.0, math.radians(turn_deg_s)))
    for tau_s in (-0.5 * T_S, 0.25 * T_S, 0.5 * T_S):
        off = aside(ways((twist,)), tau_s) - exact_aside(twist, 1.0, tau_s)
        # The third order in half the angle, and what the next pixel's flow differs by.
        angle = math.radians(turn_deg_s) * abs(tau_s)
        limit = CAMERA.rim_radius_px * angle**3 + 0.05
        assert np.hypot(*off[:, INSIDE]).max() < limit
    assert limit < 0.2


def test_way_when_turning_without_its_bend_would_be_a_chord() -> None:
    twist = Twist(angular_rad_s=(0.0, 0.0, math.radians(180.0)))
    chord = -ways((twist,)).motion.flow(EVERY, EVERY) * (0.5 * T_S)
    off = chord - exact_aside(twist, 1.0, 0.5 * T_S)
    assert np.hypot(*off[:, INSIDE]).max() > 0.2


@pytest.mark.parametrize("tau_s", [-0.5 * T_S, 0.5 * T_S])
def test_way_when_driving_and_turning_is_that_of_the_points(tau_s: float) -> None:
    twist = Twist((-0.5, 0.1, 0.0), (0.0, 0.0, 1.0))
    off = aside(ways((twist,), 0.5), tau_s) - exact_aside(twist, 0.5, tau_s)
    assert np.hypot(*off[:, INSIDE]).max() < 0.12


def slab(mover: float, range_m: float) -> tuple[Geometry, np.ndarray]:
    """Return something near in the columns 200 to 240 before a background, and where it is."""
    ranges, movers = np.full(SHAPE, 4.0, np.float32), np.zeros(SHAPE, np.float32)
    ranges[:, 200:240], movers[:, 200:240] = range_m, mover
    return Geometry(ranges, movers), np.broadcast_to(np.arange(SHAPE[1]), SHAPE).reshape(-1)


def shown_columns(motion: tuple[Twist, ...], mover: float, tau_s: float) -> np.ndarray:
    """Return whether the pixels of the middle row show the slab, at a time."""
    geometry, _ = slab(mover, 0.8)
    row = EVERY.reshape(SHAPE)[SHAPE[0] // 2 + 20]
    u_px = row % SHAPE[1] + ways(motion, geometry=geometry).to(row).aside(np.array(tau_s))[0]
    return (u_px >= 199.5) & (u_px < 239.5)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_body_when_it_moves_covers_what_it_comes_to_and_uncovers_what_it_leaves(
    sign: float,
) -> None:
    motion = (AT_REST, RIGHT)
    geometry, _ = slab(1.0, 0.8)
    row = EVERY.reshape(SHAPE)[SHAPE[0] // 2 + 20]
    flow = ways(motion, geometry=geometry).motion.flow(row[200:240], row[200:240])[0]
    tau_s = sign * 4.0 / float(np.abs(flow).max())  # some 4 px
    shown = np.flatnonzero(shown_columns(motion, 1.0, tau_s))
    first, last = flow[0] * tau_s, flow[-1] * tau_s
    assert abs(first) > 2.0
    assert shown[0] == pytest.approx(200 + first, abs=1.0)
    assert shown[-1] == pytest.approx(239 + last, abs=1.0)
    assert (np.diff(shown) == 1).all()


def test_background_when_it_moves_behind_a_body_that_stays_never_takes_its_light() -> None:
    for tau_s in (-T_S, T_S):
        shown = np.flatnonzero(shown_columns((Twist((0.0, 3.0, 0.0)), AT_REST), 1.0, tau_s))
        np.testing.assert_array_equal(shown, np.arange(200, 240))


def test_border_in_depth_when_driving_keeps_each_sides_speed() -> None:
    geometry, _ = slab(0.0, 0.5)
    found = ways((RIGHT,), geometry=geometry)
    row = EVERY.reshape(SHAPE)[SHAPE[0] // 2 + 20]
    way = found.to(row).aside(np.array(0.5 * T_S))[0]
    flow = found.motion.flow(row, row)[0]
    away = np.r_[100:190, 210:230, 250:290]
    np.testing.assert_allclose(way[away], -flow[away] * 0.5 * T_S, atol=1e-6)


def test_speed_when_a_body_is_within_reach_is_also_its() -> None:
    geometry, column = slab(1.0, 0.8)
    speed = ways((AT_REST, RIGHT), geometry=geometry).speed_px_s
    assert (speed[INSIDE & ((column < 188) | (column > 251))] == 0.0).all()
    for beside in (199, 193, 241, 249):
        assert speed[(SHAPE[0] // 2 + 20) * SHAPE[1] + beside] > 10.0


def test_way_when_nothing_moves_is_none() -> None:
    assert not aside(ways((AT_REST, AT_REST)), T_S).any()
    still = replace(AT_REST)
    assert not ways((still,)).speed_px_s.any()
