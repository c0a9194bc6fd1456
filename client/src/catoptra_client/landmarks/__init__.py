"""Landmark detection: colour histograms, the likelihood-ratio classifiers of Eq. 3, the detector.

Train once with `label_frame`, `train` and `save_classifier`; then `make_detector` once per camera
and `detect` for every frame. Source: Schmits & Visser 2009, section 3.2.
"""

from catoptra_client.landmarks.blobs import Blob, Viewpoint, blobs_from_labels, world_from_mirror
from catoptra_client.landmarks.candidates import Detection, level_detection
from catoptra_client.landmarks.classifier import (
    COLOUR_CODES,
    DEFAULT_THETA,
    NO_COLOUR,
    ColourClassifier,
    Histogram,
    classifier_from_histograms,
    histogram_from_pixels,
    label_image,
    load_classifier,
    merge_histograms,
    save_classifier,
    smooth_histogram,
)
from catoptra_client.landmarks.detector import (
    DEFAULT_CYLINDER,
    DetectionStages,
    Detector,
    detect,
    detect_with_stages,
    make_detector,
)
from catoptra_client.landmarks.training import (
    IGNORE_LABEL,
    LabelMargins,
    TrainingHistograms,
    add_labelled_frame,
    empty_training_histograms,
    label_frame,
    train,
)

__all__ = [
    "COLOUR_CODES",
    "DEFAULT_CYLINDER",
    "DEFAULT_THETA",
    "IGNORE_LABEL",
    "NO_COLOUR",
    "Blob",
    "ColourClassifier",
    "Detection",
    "DetectionStages",
    "Detector",
    "Histogram",
    "LabelMargins",
    "TrainingHistograms",
    "Viewpoint",
    "add_labelled_frame",
    "blobs_from_labels",
    "classifier_from_histograms",
    "detect",
    "detect_with_stages",
    "empty_training_histograms",
    "histogram_from_pixels",
    "label_frame",
    "label_image",
    "level_detection",
    "load_classifier",
    "make_detector",
    "merge_histograms",
    "save_classifier",
    "smooth_histogram",
    "train",
    "world_from_mirror",
]
