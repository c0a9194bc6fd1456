"""Training labels against synthetic frames, which are cast by independent code."""

from __future__ import annotations

import numpy as np

from catoptra_client.landmarks import (
    COLOUR_CODES,
    IGNORE_LABEL,
    NO_COLOUR,
    LabelMargins,
    Viewpoint,
    label_frame,
    world_from_mirror,
)
from client.landmarks import synthetic_frames

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
