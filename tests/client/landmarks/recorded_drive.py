"""A drive through the field: what detector and filter computed for it before they were made faster.

Recorded with every digit by the plain implementation: labels of the frame's own pixels, unwarped,
and the eigenvectors and solvers of LAPACK in the filter. Run as a module, this prints the record of
the implementation at hand: `python -m client.landmarks.recorded_drive > recorded_drive.json`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_client.landmarks import (
    ColourClassifier,
    Detection,
    Detector,
    Viewpoint,
    detect,
    label_frame,
    make_detector,
    train,
    world_from_mirror,
)
from catoptra_client.localization import (
    PAPER_GATE,
    Belief,
    Control,
    MotionNoise,
    find_landmark_position,
    make_landmark_map,
    measurement_from_detection,
    predict,
    update,
)
from catoptra_client.localization.motion_model import propagate_pose
from client.landmarks import synthetic_frames

RECORD = Path(__file__).with_suffix(".json")
# Spread over the field and all headings, so that every colour is lit from every side.
TRAINING_POSES = [
    (-2.0, -1.2, 0.3),
    (1.9, 1.1, 2.6),
    (0.4, -1.3, -1.2),
    (-0.5, 1.2, -2.7),
    (2.0, -0.4, 1.4),
    (-1.9, 0.5, -0.2),
]
NOISE = MotionNoise(0.01, 0.001, 0.0005, 0.0064)
# A spiral inwards: every landmark passes ahead, behind (the seam) and at many ranges.
CONTROLS = [Control(0.6 * (1.0 - i / 8), 0.9) for i in range(8)]
LANDMARK_MAP = make_landmark_map(synthetic_frames.FIELD_LANDMARKS)
# Off the mirror's axis too: the change of origin is then no identity.
VIEWPOINTS = (Viewpoint(), Viewpoint(0.6, 0.12, -0.05))


def train_classifier() -> ColourClassifier:
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


def compute_drive(classifier: ColourClassifier) -> list[dict[str, Any]]:
    """Detections, beliefs and statistics of all steps, for each viewpoint."""
    poses = _make_poses()
    frames = [
        synthetic_frames.render_frame(synthetic_frames.FIELD_LANDMARKS, tuple(pose), seed=seed)
        for seed, pose in enumerate(poses[1:])
    ]
    steps = []
    for viewpoint in VIEWPOINTS:
        detector = make_detector(
            synthetic_frames.make_camera(),
            classifier,
            landmarks=synthetic_frames.FIELD_LANDMARKS,
            viewpoint=viewpoint,
        )
        belief = Belief(poses[0], np.diag([0.01, 0.01, 0.003]))
        for control, frame in zip(CONTROLS, frames, strict=True):
            belief, step = _compute_step(predict(belief, control, noise=NOISE), detector, frame)
            steps.append(step)
    return steps


def _make_poses() -> list[np.ndarray]:
    poses = [np.array([-1.5, -0.9, 0.0])]
    for control in CONTROLS:
        poses.append(propagate_pose(poses[-1], control))
    return poses


def _compute_step(
    belief: Belief, detector: Detector, frame: np.ndarray
) -> tuple[Belief, dict[str, Any]]:
    """Belief corrected by the landmarks of a frame, and all results as JSON has them."""
    detections, updates = detect(detector, frame), []
    for detection in detections:
        result = update(
            belief,
            measurement_from_detection(detection),
            landmark=find_landmark_position(LANDMARK_MAP, detection.name),
            gate=PAPER_GATE,
        )
        belief = result.belief
        updates.append([str(result.status), result.nis])
    return belief, {
        "detections": [_describe(detection) for detection in detections],
        "updates": updates,
        "mean": belief.mean.tolist(),
        "covariance": belief.covariance.ravel().tolist(),
    }


def _describe(detection: Detection) -> list[Any]:
    numbers = (detection.range_m, detection.bearing_rad, *detection.covariance.ravel().tolist())
    return [detection.name, detection.num_pixels, detection.has_range, *numbers]


if __name__ == "__main__":
    print(json.dumps(compute_drive(train_classifier()), indent=None))
