"""Beacons from ideal blobs: ranges, and pairs that are no beacon."""

from __future__ import annotations

import dataclasses
import math

import pytest

from catoptra_client.landmarks.blobs import Viewpoint
from catoptra_client.landmarks.candidates import CylinderView
from catoptra_client.landmarks.detector import DEFAULT_CYLINDER, find_beacon_candidates
from catoptra_protocol.landmarks import Landmark
from client.landmarks import synthetic_frames
from client.landmarks.ideal_blobs import make_blob

CYLINDER = DEFAULT_CYLINDER
VIEW = CylinderView(synthetic_frames.make_camera(), CYLINDER, Viewpoint())
BEACON = Landmark("b", "beacon", 0.0, 0.0, 0.1, 0.1, 0.2, 0.4, "cyan", "magenta")


def make_band(colour: str, heights_m: tuple[float, float], **scene):
    return make_blob(CYLINDER, colour, **({"heights_m": heights_m, "width_m": 0.1} | scene))


def make_band_pair(range_m: float, azimuth_rad: float = 0.0, viewpoint_height_m: float = 0.6):
    scene = {
        "range_m": range_m,
        "azimuth_rad": azimuth_rad,
        "viewpoint_height_m": viewpoint_height_m,
    }
    return make_band("cyan", (0.2, 0.3), **scene), make_band("magenta", (0.3, 0.4), **scene)


@pytest.mark.parametrize("range_m", [0.4, 1.0, 2.0, 3.0, 5.0])
@pytest.mark.parametrize("azimuth_rad", [0.0, 1.0, -3.0, math.pi])
def test_ideal_pair_gives_its_front_range_and_azimuth(range_m, azimuth_rad) -> None:
    (found,) = find_beacon_candidates(VIEW, BEACON, make_band_pair(range_m, azimuth_rad))
    assert found.has_range
    assert found.measurement.range_m == pytest.approx(range_m + 0.05 * math.pi / 4)
    assert math.cos(found.measurement.azimuth_rad - azimuth_rad) == pytest.approx(1.0)


def test_beacon_above_the_viewpoint_is_ranged_too() -> None:
    low = CylinderView(synthetic_frames.make_camera(), CYLINDER, Viewpoint(0.12))
    (found,) = find_beacon_candidates(low, BEACON, make_band_pair(2.0, viewpoint_height_m=0.12))
    assert found.measurement.range_m == pytest.approx(2.0 + 0.05 * math.pi / 4)


def test_band_near_the_horizon_has_a_bearing_but_no_range() -> None:
    level = CylinderView(synthetic_frames.make_camera(), CYLINDER, Viewpoint(0.258))
    (found,) = find_beacon_candidates(level, BEACON, make_band_pair(2.0, viewpoint_height_m=0.258))
    assert not found.has_range
    assert found.measurement.azimuth_rad == pytest.approx(0.0, abs=1e-9)


def test_lower_band_cut_by_the_image_has_no_range() -> None:
    lower, upper = make_band_pair(0.4)
    cut = dataclasses.replace(lower, bottom=float(CYLINDER.rows))
    (found,) = find_beacon_candidates(VIEW, BEACON, (cut, upper))
    assert not found.has_range


def has_no_candidates(*blobs) -> bool:
    return find_beacon_candidates(VIEW, BEACON, blobs) == []


def test_one_band_alone_is_rejected() -> None:
    lower, upper = make_band_pair(1.5)
    assert has_no_candidates(lower)
    assert has_no_candidates(upper)


def test_swapped_colours_are_rejected() -> None:
    assert has_no_candidates(
        make_band("magenta", (0.2, 0.3), range_m=1.5), make_band("cyan", (0.3, 0.4), range_m=1.5)
    )


def test_bands_side_by_side_are_rejected() -> None:
    lower, _ = make_band_pair(1.5)
    assert has_no_candidates(lower, make_band_pair(1.5, 0.2)[1])


def test_bands_of_two_ranges_are_rejected() -> None:
    assert has_no_candidates(make_band_pair(0.8)[0], make_band_pair(2.5)[1])


def test_band_much_too_wide_is_rejected() -> None:
    lower, upper = make_band_pair(1.5)
    assert has_no_candidates(
        make_blob(CYLINDER, "cyan", heights_m=(0.2, 0.3), width_m=0.8, range_m=1.5), upper
    )
    assert has_no_candidates(
        lower, make_blob(CYLINDER, "magenta", heights_m=(0.3, 0.4), width_m=0.8, range_m=1.5)
    )


def test_band_on_the_wrong_side_of_the_horizon_is_rejected() -> None:
    lower = make_band("cyan", (0.62, 0.66), range_m=1.5)
    assert has_no_candidates(lower, make_band("magenta", (0.66, 0.7), range_m=1.5))
