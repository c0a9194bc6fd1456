"""Blobs of a labelled cylinder, and the viewpoint that they are seen from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.landmarks.blobs import (
    Blob,
    Viewpoint,
    blobs_from_labels,
    robot_from_viewpoint_polar,
    world_from_mirror,
)
from catoptra_client.landmarks.classifier import COLOUR_CODES
from catoptra_protocol.errors import DomainError

CYAN, MAGENTA = COLOUR_CODES["cyan"], COLOUR_CODES["magenta"]

Part = tuple[int, int, int, int]


def make_labels(*boxes: tuple[int, int, int, int], code: int = CYAN) -> np.ndarray:
    """Labels (20, 40) with boxes of (left, right, top, bottom)."""
    labels = np.zeros((20, 40), dtype=np.uint8)
    for left, right, top, bottom in boxes:
        labels[top:bottom, left:right] = code
    return labels


def find_blobs(labels: np.ndarray, min_pixels: int = 1) -> tuple[Blob, ...]:
    return blobs_from_labels(labels, min_pixels=min_pixels)


def test_blob_has_centred_coordinates() -> None:
    assert find_blobs(make_labels((10, 14, 5, 8))) == (Blob("cyan", 12, 12.0, 6.5, 10, 14, 5, 8),)


def test_colours_do_not_join() -> None:
    labels = make_labels((10, 14, 5, 8)) + make_labels((10, 14, 8, 11), code=MAGENTA)
    assert [blob.colour for blob in find_blobs(labels)] == ["cyan", "magenta"]


def test_small_blobs_are_left_out() -> None:
    assert find_blobs(make_labels((3, 5, 3, 5), (10, 11, 3, 6)), min_pixels=4) == (
        Blob("cyan", 4, 4.0, 4.0, 3, 5, 3, 5),
    )


def test_blob_across_the_seam_is_one_and_runs_on() -> None:
    (blob,) = find_blobs(make_labels((38, 40, 5, 8), (0, 4, 5, 8)))
    assert (blob.num_pixels, blob.left, blob.right) == (18, 38, 44)
    assert blob.column == pytest.approx(41.0)


def test_halves_that_are_small_alone_count_together() -> None:
    (blob,) = find_blobs(make_labels((39, 40, 5, 8), (0, 1, 5, 8)), min_pixels=6)
    assert blob.num_pixels == 6


@pytest.mark.parametrize(
    ("left", "right", "number"),
    [
        ((38, 40, 5, 8), (0, 3, 8, 10), 1),
        ((38, 40, 5, 8), (0, 3, 9, 11), 2),
        ((38, 40, 0, 2), (0, 3, 18, 20), 2),
    ],
    ids=["diagonal touch", "one row apart", "top and bottom row"],
)
def test_touch_across_the_seam_joins(left: Part, right: Part, number: int) -> None:
    assert len(find_blobs(make_labels(left, right))) == number


@pytest.mark.parametrize(
    ("parts", "edges"),
    [
        (((36, 40, 3, 12), (0, 3, 3, 5), (0, 2, 9, 12)), (36, 43)),
        (((0, 4, 3, 12), (37, 40, 3, 5), (38, 40, 9, 12)), (37, 44)),
    ],
)
def test_fork_across_the_seam_joins_all_its_parts(
    parts: tuple[Part, ...], edges: tuple[int, int]
) -> None:
    (blob,) = find_blobs(make_labels(*parts))
    assert blob.num_pixels == 36 + 6 + 6
    assert (blob.left, blob.right) == edges


def test_ring_around_the_whole_turn_is_one_blob() -> None:
    (blob,) = find_blobs(make_labels((0, 40, 3, 5)))
    assert (blob.num_pixels, blob.width) == (80, 40)


def test_ring_with_a_step_terminates() -> None:
    assert len(find_blobs(make_labels((0, 25, 3, 5), (20, 40, 4, 6)))) == 1


def test_nothing_is_found_in_nothing() -> None:
    assert find_blobs(make_labels()) == ()


def test_viewpoint_stands_above_the_robot_turned_with_it() -> None:
    pose = world_from_mirror(Viewpoint(0.6, forward_m=0.2), np.array([1.0, 2.0, math.pi / 2]))
    np.testing.assert_allclose(pose.translation, [1.0, 2.2, -0.6], atol=1e-15)
    np.testing.assert_allclose(pose.rotate_directions(np.array([1.0, 0, 0])), [0, 1, 0], atol=1e-15)


def test_polar_without_an_offset_is_unchanged() -> None:
    range_m, bearing, jacobian = robot_from_viewpoint_polar(Viewpoint(), np.array([2.0, 0.5]))
    assert (range_m, bearing) == (2.0, 0.5)
    np.testing.assert_array_equal(jacobian, np.eye(2))


def test_polar_with_an_offset_adds_the_vectors() -> None:
    viewpoint = Viewpoint(0.6, forward_m=-1.0, right_m=1.0)
    range_m, bearing, _ = robot_from_viewpoint_polar(viewpoint, np.array([1.0, 0.0]))
    assert (range_m, bearing) == pytest.approx((1.0, math.pi / 2))


def test_jacobian_of_an_offset_equals_differences() -> None:
    viewpoint, polar, step = Viewpoint(0.6, forward_m=0.3, right_m=-0.2), np.array([1.7, 2.5]), 1e-6
    ours = robot_from_viewpoint_polar(viewpoint, polar)[2]
    for column in range(2):
        off = np.eye(2)[column] * step
        ahead = robot_from_viewpoint_polar(viewpoint, polar + off)[:2]
        behind = robot_from_viewpoint_polar(viewpoint, polar - off)[:2]
        differences = np.subtract(ahead, behind) / (2 * step)
        np.testing.assert_allclose(ours[:, column], differences, rtol=0, atol=1e-9)


@pytest.mark.parametrize("height", [0.0, -0.6, math.nan, math.inf])
def test_viewpoint_in_the_floor_is_rejected(height: float) -> None:
    with pytest.raises(DomainError, match="above the floor"):
        Viewpoint(height)


def test_point_at_the_robots_origin_has_no_bearing() -> None:
    with pytest.raises(DomainError, match="no bearing"):
        robot_from_viewpoint_polar(Viewpoint(0.6, 0.5), np.array([0.5, math.pi]))
