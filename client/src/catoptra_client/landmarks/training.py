"""Training: from frames to labels by exact geometry, to histograms, to a classifier.

One ray per pixel centre meets the nearest surface, without shading or other objects. A beacon is a
cylinder with a lid, a goal three upright boards open to the world's origin, as in
`catoptra_protocol.landmarks`. World frame: z down, floor at z = 0, so a point at height h has z =
-h. Landmark colours are eroded by a margin, so that no mixed border pixel is learnt; pixels farther
than a wider margin from every landmark are negatives; pixels in between are ignored. Only landmarks
are modelled: frames in which a wall hides a landmark are unsuitable.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from catoptra_client.landmarks.classifier import (
    COLOUR_CODES,
    DEFAULT_BINS,
    DEFAULT_THETA,
    NO_COLOUR,
    ColourClassifier,
    Histogram,
    UInt8Array,
    classifier_from_histograms,
    empty_histogram,
    histogram_from_pixels,
    merge_histograms,
    smooth_histogram,
)
from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose

# White post below a beacon's band: part of a landmark, so neither a colour nor a negative.
WHITE_CODE = 1 + max(COLOUR_CODES.values())


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Rays in the world frame."""

    origin: Floats
    """Origin (3,) of all, or (n, 3) of each, in metres."""
    directions: Floats
    """Directions (n, 3), of any length."""


@dataclass(frozen=True, slots=True, eq=False)
class _Hits:
    """Intersections of rays with a surface."""

    distances: Floats
    """Distances (n,) in units of the direction's length; inf for a miss."""
    codes: UInt8Array
    """Colour codes (n,) of the surface."""


def nearest_surface_codes(rays: Rays, landmarks: Iterable[Landmark]) -> UInt8Array:
    """Code (n,) of the nearest surface along each ray: a colour's, `WHITE_CODE`, or `NO_COLOUR`."""
    nearest = np.full(len(rays.directions), math.inf)
    codes = np.full(len(rays.directions), NO_COLOUR, dtype=np.uint8)
    for landmark in landmarks:
        for hits in _INTERSECTIONS[landmark.kind](rays, landmark):
            nearer = hits.distances < nearest
            nearest = np.where(nearer, hits.distances, nearest)
            codes = np.where(nearer, hits.codes, codes)
    return codes


def _intersect_beacon(rays: Rays, landmark: Landmark) -> list[_Hits]:
    to_axis = np.array([landmark.x_m, landmark.y_m]) - rays.origin[..., :2]
    level = rays.directions[:, :2]
    # Solve |s level - to_axis| = radius for the nearer s.
    a = np.square(level).sum(axis=1)
    b = (level * to_axis).sum(axis=-1)
    c = np.square(to_axis).sum(axis=-1) - (0.5 * landmark.width_m) ** 2
    root = np.square(b) - a * c
    hits = (root >= 0.0) & (a > 0.0) & (b > 0.0) & (c > 0.0)
    # c / (b + sqrt) is the nearer root without the cancellation of (b - sqrt) / a.
    distance = np.where(hits, c / np.where(hits, b + np.sqrt(np.maximum(root, 0.0)), 1.0), 0.0)
    height = -(rays.origin[..., 2] + distance * rays.directions[:, 2])
    hits &= (height >= 0.0) & (height <= landmark.band_top_m)
    code = _band_code(landmark, height)
    side = _Hits(np.where(hits, distance, math.inf), code)
    return [side, _intersect_cap(rays, landmark)]


def _band_code(landmark: Landmark, height: Floats) -> UInt8Array:
    lower, upper = COLOUR_CODES[landmark.lower_colour], COLOUR_CODES[landmark.upper_colour]
    coloured = np.where(height < landmark.band_centre_m, lower, upper)
    return np.where(height < landmark.band_bottom_m, WHITE_CODE, coloured).astype(np.uint8)


def _intersect_cap(rays: Rays, landmark: Landmark) -> _Hits:
    """Intersections with the lid, from above only."""
    drop = -landmark.band_top_m - rays.origin[..., 2]
    descends = rays.directions[:, 2] > 0.0
    distance = drop / np.where(descends, rays.directions[:, 2], 1.0)
    points = rays.origin[..., :2] + distance[:, None] * rays.directions[:, :2]
    off_axis = np.hypot(points[:, 0] - landmark.x_m, points[:, 1] - landmark.y_m)
    hits = descends & (distance > 0.0) & (off_axis <= 0.5 * landmark.width_m)
    code = np.full(len(descends), COLOUR_CODES[landmark.upper_colour], dtype=np.uint8)
    return _Hits(np.where(hits, distance, math.inf), code)


def _intersect_goal(rays: Rays, landmark: Landmark) -> list[_Hits]:
    half = 0.5 * landmark.width_m
    # The goal is open to the world's origin: the back lies behind the mouth, away from the origin.
    back = landmark.x_m + math.copysign(landmark.depth_m, landmark.x_m)
    depths = (min(landmark.x_m, back), max(landmark.x_m, back))
    widths = (landmark.y_m - half, landmark.y_m + half)
    boards = [(0, back, widths), (1, widths[0], depths), (1, widths[1], depths)]
    return [_intersect_board(rays, landmark, axis, at_m, span) for axis, at_m, span in boards]


def _intersect_board(
    rays: Rays, landmark: Landmark, axis: int, position_m: float, span: tuple[float, float]
) -> _Hits:
    """Intersections with an upright board at `position_m` on an axis, over a span of the other."""
    normal_component = rays.directions[:, axis]
    # NaN marks parallel rays: every comparison below is then false, so the ray misses.
    divisor = np.where(normal_component == 0.0, math.nan, normal_component)
    distance = (position_m - rays.origin[..., axis]) / divisor
    reach = np.where(distance > 0.0, distance, 0.0)
    points = rays.origin + reach[:, None] * rays.directions
    lateral, height = points[:, 1 - axis], -points[:, 2]
    hits = (reach > 0.0) & _is_within(lateral, *span) & _is_within(height, 0.0, landmark.band_top_m)
    code = _band_code(landmark, height)
    return _Hits(np.where(hits, reach, math.inf), code)


def _is_within(values: Floats, low: float, high: float) -> Bools:
    return (values >= low) & (values <= high)


_INTERSECTIONS: dict[str, Callable[[Rays, Landmark], list[_Hits]]] = {
    "beacon": _intersect_beacon,
    "goal": _intersect_goal,
}


IGNORE_LABEL = 255


@dataclass(frozen=True, slots=True)
class LabelMargins:
    """Margins, in pixels, between labels and the borders of landmarks."""

    erosion_px: int = 1
    """Erosion of landmark colours; 1 px is the reach of a renderer's pixel filter."""
    clearance_px: int = 3
    """Distance of negatives from landmarks; 3 px cover defocus and a pose error of centimetres."""


def label_frame(
    camera: OmniCamera,
    landmarks: Sequence[Landmark],
    *,
    world_from_mirror: Pose,
    margins: LabelMargins = LabelMargins(),
) -> UInt8Array:
    """Labels (h, w) of a frame: a colour's code, `NO_COLOUR` for negatives, `IGNORE_LABEL`.

    Args:
        camera: model of the camera that delivers the frame.
        landmarks: all landmarks of the world, on the floor z = 0.
        world_from_mirror: pose of the mirror frame at the exposure.
        margins: widths of the ignored borders.
    """
    origin, direction, visible = ray_from_pixel(camera, pixel_sample_positions(camera)[:, :, 0])
    directions = world_from_mirror.rotate_directions(direction).reshape(-1, 3)
    # Of a mirror without a single viewpoint each ray begins at the mirror's own point.
    begin = world_from_mirror.translation
    if not camera.is_central:
        begin = world_from_mirror.transform_points(origin).reshape(-1, 3)
    rays = Rays(begin, directions)
    codes = np.where(
        visible, nearest_surface_codes(rays, landmarks).reshape(visible.shape), NO_COLOUR
    )
    labels = np.full(visible.shape, IGNORE_LABEL, dtype=np.uint8)
    # Eroded once more: pixels at the rim mix mirror and background.
    labels[_erode(~_dilate(codes != NO_COLOUR, margins.clearance_px) & visible, 1)] = NO_COLOUR
    for code in COLOUR_CODES.values():
        labels[_erode(codes == code, margins.erosion_px)] = code
    return labels


def _erode(mask: Bools, margin_px: int) -> Bools:
    return ~_dilate(~mask, margin_px)


def _dilate(mask: Bools, margin_px: int) -> Bools:
    size = 2 * margin_px + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel), dtype=np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class TrainingHistograms:
    """Pixel counts of the labelled frames so far."""

    positives: dict[str, Histogram]
    """Histogram of each landmark colour."""
    negative: Histogram
    """Histogram of all other pixels."""


def empty_training_histograms(bins: int = DEFAULT_BINS) -> TrainingHistograms:
    """Histograms before the first frame."""
    return TrainingHistograms(
        {colour: empty_histogram(bins) for colour in COLOUR_CODES}, empty_histogram(bins)
    )


def add_labelled_frame(
    histograms: TrainingHistograms, frame: UInt8Array, *, labels: UInt8Array
) -> TrainingHistograms:
    """Histograms with one more frame: (h, w, 3) RGB and its (h, w) labels.

    Raises:
        DomainError: frame and labels differ in size.
    """
    if frame.shape != (*labels.shape, 3):
        raise DomainError(f"labels {labels.shape} do not belong to a frame {frame.shape}")
    bins = histograms.negative.bins

    def accumulate(histogram: Histogram, code: int) -> Histogram:
        return merge_histograms(histogram, histogram_from_pixels(frame[labels == code], bins))

    positives = {c: accumulate(histograms.positives[c], code) for c, code in COLOUR_CODES.items()}
    return TrainingHistograms(positives, accumulate(histograms.negative, NO_COLOUR))


def train(
    labelled_frames: Iterable[tuple[UInt8Array, UInt8Array]],
    *,
    theta: float = DEFAULT_THETA,
    bins: int = DEFAULT_BINS,
) -> ColourClassifier:
    """Train a classifier on (frame, labels) pairs, in any order.

    Args:
        labelled_frames: (h, w, 3) RGB frames with their (h, w) labels.
        theta: threshold of Eq. 3.
        bins: bins per channel.
    """
    histograms = empty_training_histograms(bins)
    for frame, labels in labelled_frames:
        histograms = add_labelled_frame(histograms, frame, labels=labels)
    # Smoothed, because some twenty frames do not show every shade of a cylinder under its lights.
    positives = {
        colour: smooth_histogram(histogram) for colour, histogram in histograms.positives.items()
    }
    return classifier_from_histograms(positives, smooth_histogram(histograms.negative), theta=theta)
