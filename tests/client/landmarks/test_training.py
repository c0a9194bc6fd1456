"""Ray casts and labels of training frames, and the training on them."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_client.landmarks import (
    COLOUR_CODES,
    IGNORE_LABEL,
    NO_COLOUR,
    LabelMargins,
    Viewpoint,
    add_labelled_frame,
    empty_training_histograms,
    label_frame,
    train,
    world_from_mirror,
)
from catoptra_client.landmarks.classifier import histogram_from_pixels
from catoptra_client.landmarks.training import WHITE_CODE, Rays, nearest_surface_codes
from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import Landmark
from client.landmarks import synthetic_frames

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


POSE = (0.9, 0.8, 0.4)


def label_synthetic_frame(
    pose=POSE, landmarks=synthetic_frames.FIELD_LANDMARKS, **margins
) -> np.ndarray:
    return label_frame(
        synthetic_frames.make_camera(),
        landmarks,
        world_from_mirror=world_from_mirror(Viewpoint(), np.array(pose)),
        margins=LabelMargins(**margins),
    )


def test_labelled_pixels_have_the_hue_of_their_colour() -> None:
    frame, labels = (
        synthetic_frames.render_frame(synthetic_frames.FIELD_LANDMARKS, POSE),
        label_synthetic_frame(),
    )
    weakest = {"cyan": 0, "magenta": 1, "yellow": 2}
    for colour, channel in weakest.items():
        pixels = frame[labels == COLOUR_CODES[colour]].astype(int)
        assert len(pixels) >= 5
        # The absent primary lies far below the other two: no border pixel was mixed in.
        assert (np.delete(pixels, channel, axis=1).min(axis=1) - pixels[:, channel] > 40).all()


def test_neg_holds_no_landmark_hue() -> None:
    frame, labels = (
        synthetic_frames.render_frame(synthetic_frames.FIELD_LANDMARKS, POSE).astype(int),
        label_synthetic_frame(),
    )
    neg = frame[labels == NO_COLOUR]
    assert (neg[:, 0] - neg[:, 1]).max() < 30  # neither magenta nor yellow
    assert (neg[:, 2] - neg[:, 0]).max() < 30  # nor cyan


def test_margins_only_ignore_more() -> None:
    close, wide = label_synthetic_frame(), label_synthetic_frame(erosion_px=2, clearance_px=6)
    differs = close != wide
    assert differs.any()
    assert (wide[differs] == IGNORE_LABEL).all()


def test_outside_the_mirror_is_ignored() -> None:
    labels = label_synthetic_frame()
    assert labels[0, 0] == IGNORE_LABEL
    assert labels[180, 180] == NO_COLOUR


def test_without_landmarks_all_of_the_mirror_is_neg() -> None:
    labels = label_synthetic_frame(landmarks=())
    assert set(np.unique(labels)) == {NO_COLOUR, IGNORE_LABEL}


FRAME = np.random.default_rng(3).integers(0, 256, (6, 7, 3), dtype=np.uint8)
LABELS = np.array([[0, 1, 2, 3, IGNORE_LABEL, 0, 1]] * 6, dtype=np.uint8)


def test_each_label_counts_into_its_own_histogram() -> None:
    histograms = add_labelled_frame(empty_training_histograms(), FRAME, labels=LABELS)
    assert [histograms.positives[c].total for c in COLOUR_CODES] == [12, 6, 6]
    assert histograms.negative.total == 12
    expected = histogram_from_pixels(FRAME[:, 2])
    np.testing.assert_array_equal(histograms.positives["magenta"].counts, expected.counts)


def test_order_of_frames_does_not_matter() -> None:
    other = FRAME[::-1].copy(), LABELS[:, ::-1].copy()
    one = train([(FRAME, LABELS), other])
    two = train([other, (FRAME, LABELS)])
    np.testing.assert_array_equal(one.lookup_table, two.lookup_table)


def test_labels_of_another_frame_are_rejected() -> None:
    with pytest.raises(DomainError, match="do not belong"):
        add_labelled_frame(empty_training_histograms(), FRAME, labels=LABELS[:3])


def test_training_on_nothing_is_rejected() -> None:
    with pytest.raises(DomainError, match="train on more frames"):
        train([])
