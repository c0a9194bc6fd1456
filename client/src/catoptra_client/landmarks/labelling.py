"""Training labels from exact geometry: the landmark colour at each pixel of a frame.

One ray per pixel centre. Landmark colours are eroded by a margin, so that no mixed border pixel is
learnt; pixels farther than a wider margin from every landmark are negatives; pixels in between are
ignored. Only landmarks are modelled: frames in which a wall hides a landmark are unsuitable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from catoptra_client.landmarks.classifier import COLOUR_CODES, NO_COLOUR
from catoptra_client.landmarks.histogram import UInt8Array
from catoptra_client.landmarks.landmark_raycast import Rays, nearest_surface_codes
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Bools
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose

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
