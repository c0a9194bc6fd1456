"""Labels for training, from the exact geometry: which pixel of a frame shows which colour.

Every pixel centre is one ray. Landmark colours are eroded by a margin, so that no mixed border
pixel is learnt; what lies farther than a wider margin from any landmark is neg; between the two a
pixel is ignored. Nothing but landmarks is known here: frames in which a wall hides a landmark are
not for training.
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
from catoptra_protocol.optics.numerics import Bools
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_sample_positions,
)
from catoptra_protocol.optics.transforms import Pose

IGNORE_LABEL = 255


@dataclass(frozen=True, slots=True)
class LabelMargins:
    """How far, in pixels, colours are eroded and neg keeps from landmarks.

    1 px: the reach of a renderer's pixel filter. 3 px: as far as defocus and a pose wrong by some
    centimetres move a border.
    """

    erosion_px: int = 1
    clearance_px: int = 3


def label_frame(
    camera: OmniCamera,
    landmarks: Sequence[Landmark],
    *,
    world_from_mirror: Pose,
    margins: LabelMargins = LabelMargins(),
) -> UInt8Array:
    """Return (h, w) labels: a colour's code, NO_COLOUR for neg, IGNORED; floor at world z = 0."""
    direction, seen = direction_from_pixel(camera, pixel_sample_positions(camera)[:, :, 0])
    directions = world_from_mirror.rotate_directions(direction).reshape(-1, 3)
    rays = Rays(world_from_mirror.translation, directions)
    codes = np.where(seen, nearest_surface_codes(rays, landmarks).reshape(seen.shape), NO_COLOUR)
    labels = np.full(seen.shape, IGNORE_LABEL, dtype=np.uint8)
    labels[_erode(~_dilate(codes != NO_COLOUR, margins.clearance_px) & seen, 1)] = NO_COLOUR
    for code in COLOUR_CODES.values():
        labels[_erode(codes == code, margins.erosion_px)] = code
    return labels


def _erode(mask: Bools, margin_px: int) -> Bools:
    return ~_dilate(~mask, margin_px)


def _dilate(mask: Bools, margin_px: int) -> Bools:
    size = 2 * margin_px + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel), dtype=np.bool_)
