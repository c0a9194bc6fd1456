"""Time of a frame at the client, from pixels to an updated belief.

Run: .venv/bin/python tests/measurements/detection_time.py

Prints the median and the 95th percentile of each stage in milliseconds of processor time, for a
360 x 360 frame on one thread: 0.95 ms in all. Decisions: the frame's labels unwarped (0.17 ms;
labels of the unwarped colours 0.54), OpenCV's 555 format and its table of 16 bits in `label_image`
(0.06 ms; `take` in NumPy 0.10, shifts in NumPy 0.34), the rectangle of a colour and 16-bit numbers
of regions in `blobs` (0.17 ms; 32-bit numbers 0.23, whole images 0.75), the algorithm there (whole
images with OpenCV's default 2.1), square roots of covariances kept in beliefs and in closed form
(0.27 ms for the filter; by LAPACK 0.74), and 720 x 180 for the cylinder.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

TESTS = Path(__file__).parents[1]
sys.path.insert(0, str(TESTS))

from catoptra_client.landmarks import (  # noqa: E402
    Detector,
    Viewpoint,
    detect,
    detect_with_stages,
    label_frame,
    label_image,
    make_detector,
    train,
    world_from_mirror,
)
from catoptra_client.landmarks.blobs import blobs_from_labels  # noqa: E402
from catoptra_client.landmarks.detector import MIN_BLOB_PIXELS, select_candidates  # noqa: E402
from catoptra_client.localization import (  # noqa: E402
    OPEN_GATE,
    Belief,
    Control,
    MotionNoise,
    make_landmark_map,
    measurement_from_detection,
    predict,
    update,
)
from catoptra_client.unwarp import unwarp, unwarp_labels  # noqa: E402
from client.landmarks import synthetic_frames  # noqa: E402

REPEATS = 200
TRAINING_POSES = [(-2.0, -1.2, 0.3), (1.9, 1.1, 2.6), (0.4, -1.3, -1.2), (-0.5, 1.2, -2.7)]
POSE = (0.3, 0.5, 0.4)


def train_detector() -> Detector:
    """Detector for the field, trained on a few synthetic frames."""
    camera, field = synthetic_frames.make_camera(), synthetic_frames.FIELD_LANDMARKS
    frames = [
        (
            synthetic_frames.render_frame(field, pose),
            label_frame(
                camera, field, world_from_mirror=world_from_mirror(Viewpoint(), np.array(pose))
            ),
        )
        for pose in TRAINING_POSES
    ]
    return make_detector(camera, train(frames), landmarks=field)


def print_time(name: str, stage: Callable[[], object]) -> None:
    """Print the median and 95th percentile of a stage."""
    stage()
    times_ms = []
    for _ in range(REPEATS):
        start = time.process_time()
        stage()
        times_ms.append(1e3 * (time.process_time() - start))
    median, late = np.percentile(times_ms, (50, 95))
    print(f"{name:<44} {median:7.3f} ms   95 % below {late:7.3f} ms")


def main() -> None:
    """Measure every stage on the same frame, and print the times."""
    cv2.setNumThreads(1)
    detector, frame = (
        train_detector(),
        synthetic_frames.render_frame(synthetic_frames.FIELD_LANDMARKS, POSE),
    )
    view, known = (
        detect_with_stages(detector, frame),
        make_landmark_map(synthetic_frames.FIELD_LANDMARKS),
    )
    belief = Belief(np.array(POSE), np.diag([0.01, 0.01, 0.01]))
    control, noise = Control(0.2, 0.05), MotionNoise(0.01, 0.0, 0.0005, 0.0064)

    def correct() -> Belief:
        new = predict(belief, control, noise=noise)
        for seen in view.detections:
            measurement = measurement_from_detection(seen)
            new = update(new, measurement, landmark=known[seen.name], gate=OPEN_GATE).belief
        return new

    size = "x".join(map(str, view.labels.shape[::-1]))
    labels = label_image(detector.classifier, frame)
    print_time("classify", lambda: label_image(detector.classifier, frame))
    print_time(f"unwarp to {size}", lambda: unwarp_labels(labels, detector.unwarp_map))
    print_time("the same in colour, for display", lambda: unwarp(frame, detector.unwarp_map))
    print_time("blobs", lambda: blobs_from_labels(view.labels, min_pixels=MIN_BLOB_PIXELS))
    print_time("identify", lambda: select_candidates(detector, view.blobs))
    print_time(f"all of detect, {len(view.detections)} landmarks", lambda: detect(detector, frame))
    print_time(f"EKF: 1 prediction, {len(view.detections)} updates", correct)
    print_time("detect and EKF together", lambda: (detect(detector, frame), correct()))


if __name__ == "__main__":
    main()
