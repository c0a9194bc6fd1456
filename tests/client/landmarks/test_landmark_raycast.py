"""Ray casting of landmarks, by cases that can be computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_client.landmarks.classifier import COLOUR_CODES, NO_COLOUR
from catoptra_client.landmarks.training import WHITE_CODE, Rays, nearest_surface_codes
from catoptra_protocol.landmarks import Landmark

CYAN, MAGENTA, YELLOW = COLOUR_CODES["cyan"], COLOUR_CODES["magenta"], COLOUR_CODES["yellow"]
BEACON = Landmark("b", "beacon", 2.0, 0.0, 0.1, 0.1, 0.2, 0.4, "magenta", "cyan")
GOAL = Landmark("g", "goal", 3.0, 0.0, 0.8, 0.3, 0.0, 0.3, "yellow", "yellow")
ORIGIN = np.array([0.0, 0.0, -0.6])


def cast_rays_at(*points, landmarks=(BEACON, GOAL)) -> list[int]:
    """Surface codes along rays from the viewpoint towards points (x, y, height)."""
    targets = np.array([(x, y, -height) for x, y, height in points])
    with np.errstate(all="raise"):
        return nearest_surface_codes(Rays(ORIGIN, targets - ORIGIN), landmarks).tolist()


def test_beacon_shows_white_then_its_lower_then_its_upper_colour() -> None:
    front = [(1.95, 0.0, height) for height in (0.01, 0.19, 0.21, 0.29, 0.31, 0.39)]
    assert cast_rays_at(*front) == [WHITE_CODE, WHITE_CODE, MAGENTA, MAGENTA, CYAN, CYAN]


def test_lid_has_the_upper_colour_and_ends_at_its_edge() -> None:
    assert cast_rays_at((2.04, 0.0, 0.4), (2.0, 0.04, 0.4)) == [CYAN, CYAN]
    assert cast_rays_at((2.06, 0.0, 0.4), landmarks=[BEACON]) == [NO_COLOUR]


def test_beacon_ends_at_its_silhouette() -> None:
    assert cast_rays_at((2.0, 0.0501, 0.25), (2.0, 0.0499, 0.25), landmarks=[BEACON]) == [
        NO_COLOUR,
        MAGENTA,
    ]


def test_goal_shows_back_and_sides_and_neither_roof_nor_floor() -> None:
    assert cast_rays_at((3.3, 0.2, 0.1), (3.1, 0.4, 0.2)) == [YELLOW, YELLOW]
    assert cast_rays_at((3.1, 0.2, 0.0), (3.3, 0.2, 0.31)) == [NO_COLOUR, NO_COLOUR]


def test_nearer_landmark_hides_the_farther_in_any_order() -> None:
    behind = (3.3, 0.0, 0.01)
    assert cast_rays_at(behind) == cast_rays_at(behind, landmarks=(GOAL, BEACON)) == [MAGENTA]


@pytest.mark.parametrize("direction", [(0, 0, 1), (0, 0, -1), (-1, 0, 0), (0, 1, 0), (0, 0, 0)])
def test_rays_along_axes_meet_nothing_and_divide_by_nothing(direction) -> None:
    with np.errstate(all="raise"):
        codes = nearest_surface_codes(Rays(ORIGIN, np.array([direction], float)), (BEACON, GOAL))
    assert codes.tolist() == [NO_COLOUR]


def test_viewpoint_inside_a_beacon_sees_no_front() -> None:
    inside = Rays(np.array([2.0, 0.01, -0.3]), np.array([[1.0, 0.0, 0.0]]))
    assert nearest_surface_codes(inside, [BEACON]).tolist() == [NO_COLOUR]
