"""Goals and beacons of ideal blobs, then whole frames: accuracy, identity, no false detections.

The sigmas in `landmarks/detector.py` are measured here.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_client.landmarks import Viewpoint, detect, detect_with_stages, make_detector
from catoptra_client.landmarks.candidates import CylinderView
from catoptra_client.landmarks.detector import (
    DEFAULT_CYLINDER,
    find_beacon_candidates,
    find_goal_candidates,
)
from catoptra_client.localization import (
    PAPER_GATE,
    Belief,
    find_landmark_position,
    measurement_from_detection,
    update,
)
from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.exports import ExportedFile, export_camera
from catoptra_protocol.calibration.formats import find_format
from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.omni_camera import pixel_from_direction
from catoptra_protocol.optics.radial_camera import Picture
from client.landmarks import synthetic_frames
from client.landmarks.ideal_blobs import make_blob
from client.landmarks.recorded_drive import LANDMARK_MAP
from helpers.long_cases import quick_cases

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


CYLINDER = DEFAULT_CYLINDER
BEACON_VIEW = CylinderView(synthetic_frames.make_camera(), CYLINDER, Viewpoint())
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
    (found,) = find_beacon_candidates(BEACON_VIEW, BEACON, make_band_pair(range_m, azimuth_rad))
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
    (found,) = find_beacon_candidates(BEACON_VIEW, BEACON, (cut, upper))
    assert not found.has_range


LOWER, UPPER = make_band_pair(1.5)
NO_BEACONS = {
    "lower band alone": (LOWER,),
    "upper band alone": (UPPER,),
    "swapped colours": (
        make_band("magenta", (0.2, 0.3), range_m=1.5),
        make_band("cyan", (0.3, 0.4), range_m=1.5),
    ),
    "side by side": (LOWER, make_band_pair(1.5, 0.2)[1]),
    "two ranges": (make_band_pair(0.8)[0], make_band_pair(2.5)[1]),
    "lower too wide": (make_band("cyan", (0.2, 0.3), width_m=0.8, range_m=1.5), UPPER),
    "upper too wide": (LOWER, make_band("magenta", (0.3, 0.4), width_m=0.8, range_m=1.5)),
    "above the horizon": (
        make_band("cyan", (0.62, 0.66), range_m=1.5),
        make_band("magenta", (0.66, 0.7), range_m=1.5),
    ),
}


@pytest.mark.parametrize("blobs", NO_BEACONS.values(), ids=NO_BEACONS)
def test_bands_that_are_no_beacon_are_rejected(blobs) -> None:
    assert find_beacon_candidates(BEACON_VIEW, BEACON, blobs) == []


BEACONS = [row for row in synthetic_frames.FIELD_LANDMARKS if row.kind == "beacon"]
# Each beacon comes to each range, at azimuths a quarter of a turn apart; -176 degrees, with the
# beacon 2.9 degrees wide at 2 m, lies close to the seam.
RANGES_M = [(0.5, 0.9, 1.4, 2.0), (0.9, 1.4, 2.0, 2.5), (1.4, 2.0, 2.5, 0.5), (2.5, 0.5, 0.9, 1.4)]
FIELD_POSES = [(1.4, 0.9, 0.4), (-1.2, -0.3, -2.0), (0.2, 1.1, 2.2), (-2.2, 1.3, 1.0)]


def place_beacons(ranges_m, first_azimuth_deg: float) -> list[Landmark]:
    """Four beacons around the robot."""
    placed = []
    for i, (row, range_m) in enumerate(zip(BEACONS, ranges_m, strict=True)):
        azimuth = math.radians(first_azimuth_deg + 90.0 * i)
        x_m, y_m = range_m * math.cos(azimuth), range_m * math.sin(azimuth)
        placed.append(dataclasses.replace(row, x_m=x_m, y_m=y_m))
    return placed


def true_polar(landmark: Landmark, pose=(0.0, 0.0, 0.0)) -> tuple[float, float]:
    dx, dy = landmark.x_m - pose[0], landmark.y_m - pose[1]
    return math.hypot(dx, dy), math.remainder(math.atan2(dy, dx) - pose[2], 2 * math.pi)


@functools.cache
def render_ring_frame(index: int):
    landmarks = place_beacons(RANGES_M[index], -176.0 + 23.0 * index)
    return landmarks, synthetic_frames.render_frame(landmarks, seed=40 + index)


@functools.cache
def render_field_frame(index: int):
    return synthetic_frames.render_frame(
        synthetic_frames.FIELD_LANDMARKS, FIELD_POSES[index], seed=60 + index
    )


def detect_by_name(classifier, landmarks, frame):
    detector = make_detector(synthetic_frames.make_camera(), classifier, landmarks=landmarks)
    return {seen.name: seen for seen in detect(detector, frame)}


@pytest.mark.parametrize("index", quick_cases(range(len(RANGES_M)), 0))
def test_every_beacon_up_to_2_5_m_is_found_and_placed(classifier, index: int) -> None:
    landmarks, frame = render_ring_frame(index)
    seen = detect_by_name(classifier, landmarks, frame)
    assert set(seen) == {row.name for row in landmarks}
    for row in landmarks:
        range_m, bearing = true_polar(row)
        found = seen[row.name]
        assert abs(found.range_m / range_m - 1.0) < 0.05
        assert abs(math.remainder(found.bearing_rad - bearing, 2 * math.pi)) < math.radians(1.0)


@pytest.mark.parametrize("name", ["opencv_omnidir", "kalibr_ds", "ocamcalib"])
def test_camera_of_a_calibration_file_serves_detector_and_filter_as_the_model_does(
    classifier, name: str, tmp_path: Path
) -> None:
    # The frames are mirrored ones, as a mirror delivers them, and so is the file.
    export = find_format(name)
    exported = export_camera(
        synthetic_frames.make_camera(), export, name="cam", picture=Picture.MIRRORED
    )
    assert isinstance(exported, ExportedFile)
    path = tmp_path / export.file_name
    path.write_text(exported.text)
    camera = camera_from_file(path)
    landmarks, frame = synthetic_frames.FIELD_LANDMARKS, render_field_frame(0)
    expected = detect_by_name(classifier, landmarks, frame)
    detector = make_detector(camera, classifier, landmarks=landmarks)
    found = {seen.name: seen for seen in detect(detector, frame)}
    assert found.keys() == expected.keys()
    assert len(found) >= 3
    beliefs = []
    for seen in (found, expected):
        belief = Belief(np.array(FIELD_POSES[0]), np.diag((0.04, 0.04, 0.01)))
        for one in seen.values():
            measurement = measurement_from_detection(one)
            position = find_landmark_position(LANDMARK_MAP, one.name)
            belief = update(belief, measurement, landmark=position, gate=PAPER_GATE).belief
        beliefs.append(belief)
    assert beliefs[0].mean == pytest.approx(beliefs[1].mean, abs=1e-4)
    for key, one in expected.items():
        assert found[key].bearing_rad == pytest.approx(one.bearing_rad, abs=1e-5)
        assert found[key].range_m == pytest.approx(one.range_m, rel=1e-4)


def test_errors_are_as_large_as_the_covariance_says(classifier) -> None:
    normalised = []
    for index in range(len(RANGES_M)):
        landmarks, frame = render_ring_frame(index)
        seen = detect_by_name(classifier, landmarks, frame)
        for row in landmarks:
            range_m, bearing = true_polar(row)
            found = seen[row.name]
            turn = math.remainder(found.bearing_rad - bearing, 2 * math.pi)
            error = np.array([found.range_m - range_m, turn])
            normalised.append(error**2 / np.diagonal(found.covariance))
    rms = np.sqrt(np.mean(normalised, axis=0))
    # Below 1 on exact frames, by design; below 0.2 the filter would waste what it is given.
    assert (rms < 1.0).all()
    assert (rms > 0.2).all()


@pytest.mark.parametrize("azimuth_deg", [180.0, 179.3, -179.3])
def test_beacon_across_the_seam_is_whole(classifier, azimuth_deg: float) -> None:
    (row,) = place_beacons((1.0, 1.0, 1.0, 1.0), azimuth_deg)[:1]
    seen = detect_by_name(classifier, [row], synthetic_frames.render_frame([row]))[row.name]
    assert seen.range_m == pytest.approx(1.0, rel=0.02)
    off = math.remainder(seen.bearing_rad - math.radians(azimuth_deg), 2 * math.pi)
    assert abs(off) < math.radians(0.3)


@pytest.mark.parametrize("index", range(len(FIELD_POSES)))
def test_field_shows_both_goals_within_their_sigmas(classifier, index: int) -> None:
    seen = detect_by_name(classifier, synthetic_frames.FIELD_LANDMARKS, render_field_frame(index))
    for row in synthetic_frames.FIELD_LANDMARKS:
        if row.kind == "goal":
            found = seen[row.name]
            _, bearing = true_polar(row, FIELD_POSES[index])
            off = math.remainder(found.bearing_rad - bearing, 2 * math.pi)
            assert not found.has_range
            assert abs(off) < 2.5 * math.sqrt(found.covariance[1, 1])


@pytest.mark.parametrize("index", range(len(FIELD_POSES)))
def test_field_beacons_within_3_m_are_found_and_none_is_wrong(classifier, index: int) -> None:
    seen = detect_by_name(classifier, synthetic_frames.FIELD_LANDMARKS, render_field_frame(index))
    for row in BEACONS:
        range_m, _ = true_polar(row, FIELD_POSES[index])
        assert row.name in seen or range_m > 2.9
        if row.name in seen:
            assert seen[row.name].range_m == pytest.approx(range_m, rel=0.05)


def test_world_without_landmarks_shows_none(classifier) -> None:
    assert (
        detect_by_name(
            classifier,
            synthetic_frames.FIELD_LANDMARKS,
            synthetic_frames.render_frame((), (0.5, -0.7, 1.0)),
        )
        == {}
    )


def test_posts_of_one_colour_are_no_landmarks(classifier) -> None:
    posts = [dataclasses.replace(row, upper_colour=row.lower_colour) for row in BEACONS]
    frame = synthetic_frames.render_frame(posts, (0.5, -0.4, 0.3))
    detector = make_detector(
        synthetic_frames.make_camera(), classifier, landmarks=synthetic_frames.FIELD_LANDMARKS
    )
    view = detect_with_stages(detector, frame)
    assert view.detections == ()
    assert len(view.unused_blobs) >= 2


def test_black_and_noisy_frames_show_nothing(classifier) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (360, 360, 3), dtype=np.uint8)
    assert detect_by_name(classifier, synthetic_frames.FIELD_LANDMARKS, noise) == {}
    assert detect_by_name(classifier, synthetic_frames.FIELD_LANDMARKS, np.zeros_like(noise)) == {}


def test_offset_viewpoint_measures_from_the_robots_origin(classifier) -> None:
    # The camera sees the world from (0.3, 0): for the robot behind it everything is 0.3 m farther.
    landmarks, frame = render_ring_frame(0)
    viewpoint = Viewpoint(0.6, forward_m=0.3)
    detector = make_detector(
        synthetic_frames.make_camera(), classifier, landmarks=landmarks, viewpoint=viewpoint
    )
    seen = {found.name: found for found in detect(detector, frame)}
    for row in landmarks:
        moved = dataclasses.replace(row, x_m=row.x_m + 0.3)
        range_m, bearing = true_polar(moved)
        assert seen[row.name].range_m == pytest.approx(range_m, rel=0.05)
        off = math.remainder(seen[row.name].bearing_rad - bearing, 2 * math.pi)
        assert abs(off) < math.radians(2.0)


def test_view_accounts_for_every_blob(classifier) -> None:
    detector = make_detector(
        synthetic_frames.make_camera(), classifier, landmarks=synthetic_frames.FIELD_LANDMARKS
    )
    view = detect_with_stages(detector, render_field_frame(0))
    pixels = sum(found.num_pixels for found in view.detections) + sum(
        b.num_pixels for b in view.unused_blobs
    )
    assert pixels == sum(blob.num_pixels for blob in view.blobs)


@pytest.mark.parametrize("index", range(len(FIELD_POSES)))
def test_labels_are_those_of_the_nearest_pixels_of_the_frame(classifier, index: int) -> None:
    camera, frame = synthetic_frames.make_camera(), render_field_frame(index)
    detector = make_detector(camera, classifier, landmarks=synthetic_frames.FIELD_LANDMARKS)
    pixel, _ = pixel_from_direction(camera, DEFAULT_CYLINDER.directions())
    # To the 1/32 px of the map; a point next to the border of two pixels has either label.
    column, row = np.moveaxis(np.floor(pixel).astype(int), -1, 0)
    inside = (np.abs(pixel - np.floor(pixel) - 0.5) < 0.5 - 1.0 / 32.0).all(axis=-1)
    expected = classifier.lookup_table[_index_of(frame[row, column])]
    found = detect_with_stages(detector, frame).labels
    assert inside.mean() > 0.8
    np.testing.assert_array_equal(found[inside], expected[inside])


def _index_of(pixels: np.ndarray) -> np.ndarray:
    red, green, blue = np.moveaxis(pixels.astype(int) >> 3, -1, 0)
    return (red << 10) + (green << 5) + blue


def test_detector_rejects_landmarks_of_equal_colours(classifier) -> None:
    twins = [BEACONS[0], dataclasses.replace(BEACONS[0], name="twin")]
    with pytest.raises(DomainError, match="do not distinguish"):
        make_detector(synthetic_frames.make_camera(), classifier, landmarks=twins)
