"""Shared by the landmark tests: one classifier, trained once on a few synthetic frames."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_client.landmarks import (
    ColourClassifier,
    Viewpoint,
    label_frame,
    train,
    world_from_mirror,
)
from client.landmarks import synthetic_frames

# Spread over the field and all headings, so that every colour is lit from every side.
TRAINING_POSES = [
    (-2.0, -1.2, 0.3),
    (1.9, 1.1, 2.6),
    (0.4, -1.3, -1.2),
    (-0.5, 1.2, -2.7),
    (2.0, -0.4, 1.4),
    (-1.9, 0.5, -0.2),
]


@pytest.fixture(scope="session")
def classifier() -> ColourClassifier:
    """Classifier of the training poses; the tests' frames have other poses."""
    return train(
        (
            synthetic_frames.render_frame(synthetic_frames.FIELD_LANDMARKS, pose, seed=seed),
            label_frame(
                synthetic_frames.make_camera(),
                synthetic_frames.FIELD_LANDMARKS,
                world_from_mirror=world_from_mirror(Viewpoint(), np.array(pose)),
            ),
        )
        for seed, pose in enumerate(TRAINING_POSES)
    )
