"""Goals from ideal blobs: bearing and sigma, and blobs that are no goal."""

from __future__ import annotations

import math

import pytest

from catoptra_client.landmarks.blobs import Viewpoint
from catoptra_client.landmarks.candidates import CylinderView
from catoptra_client.landmarks.detector import DEFAULT_CYLINDER, find_goal_candidates
from catoptra_protocol.landmarks import Landmark
from client.landmarks import synthetic_frames
from client.landmarks.ideal_blobs import make_blob

VIEW = CylinderView(synthetic_frames.make_camera(), DEFAULT_CYLINDER, Viewpoint())
GOAL = Landmark("g", "goal", 2.7, 0.0, 0.8, 0.3, 0.0, 0.3, "yellow", "yellow")


def find_candidates(
    colour: str = "yellow", *, heights_m=(0.0, 0.3), width_m=0.8, range_m=2.0, **place
):
    blob = make_blob(
        DEFAULT_CYLINDER, colour, heights_m=heights_m, width_m=width_m, range_m=range_m, **place
    )
    return find_goal_candidates(VIEW, GOAL, (blob,))


@pytest.mark.parametrize("range_m", [0.8, 2.0, 5.0])
@pytest.mark.parametrize("azimuth_rad", [0.0, -1.2, math.pi])
def test_goal_gives_a_bearing_and_no_range(range_m, azimuth_rad) -> None:
    (found,) = find_candidates(range_m=range_m, azimuth_rad=azimuth_rad)
    assert not found.has_range
    assert math.cos(found.measurement.azimuth_rad - azimuth_rad) == pytest.approx(1.0)


def test_bearing_is_less_sure_nearby() -> None:
    near, far = (
        find_candidates(range_m=0.8)[0].measurement,
        find_candidates(range_m=4.0)[0].measurement,
    )
    assert near.azimuth_sigma_rad > 4 * far.azimuth_sigma_rad


@pytest.mark.parametrize(
    "blob",
    [
        {"colour": "cyan"},
        {"heights_m": (0.2, 0.3), "width_m": 0.1},  # a beacon's band whose partner was missed
        {"heights_m": (0.3, 0.4), "width_m": 0.1},
        {"width_m": 2.5},  # a wall
        {"heights_m": (0.28, 0.3)},  # a line
        {"heights_m": (0.0, 0.7)},  # rises above the horizon
    ],
)
def test_blob_of_another_size_is_no_goal(blob) -> None:
    assert find_candidates(**blob) == []
