"""Labels of an image, known from what each ray meets: channels of pixels, objects, boxes.

A channel has one value, or a few, for each pixel of the picture; its ray is that of the pixel's
centre. Lengths are metres along the ray, directions are in the mirror
frame, positions in the world.

One table has names, types and meaning of the channels; `GroundTruth` holds the channels and objects
of one image.

To add a channel: a row here, its computation in the server's `frames/labels/`, its row in SPEC.md.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass

Channels = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class LabelledObject:
    """An object of the world, or a robot, with its box at the time of the exposure."""

    number: int
    """Value of the channel `ids`, from 1."""
    name: str
    class_name: str
    class_number: int
    """Value of the channel `classes`, from 1."""
    world_from_box: Pose
    """Pose of the box's centre, axes along its edges."""
    half_size_m: Floats
    """(3,) half lengths of the edges."""

    def corners(self) -> Floats:
        """(8, 3) corners in the world frame; bit k of the row's number: positive along axis k."""
        signs = np.array([[(row >> axis & 1) * 2.0 - 1.0 for axis in range(3)] for row in range(8)])
        return self.world_from_box.transform_points(signs * self.half_size_m)


@dataclass(frozen=True, slots=True, eq=False)
class GroundTruth:
    """What is known of one image."""

    channels: Channels
    """Arrays by the names of `LABEL_CHANNELS`."""
    objects: tuple[LabelledObject, ...] = ()
    """All objects of the world, whether in view or not, by ascending number."""


@dataclass(frozen=True, slots=True)
class LabelChannel:
    """One channel of ground truth."""

    name: str
    """Name in requests and of files."""
    dtype: str
    """Type of a value as NumPy writes it, little-endian."""
    depth: int
    """Values of a pixel."""
    nothing: float
    """Value of pixels without a surface or outside the image."""
    meaning: str
    """Unit, frame and meaning."""

    def shape(self, height_px: int, width_px: int) -> tuple[int, ...]:
        """Shape of the array of an image: (h, w), or (h, w, depth)."""
        return (height_px, width_px) if self.depth == 1 else (height_px, width_px, self.depth)


_CHANNELS = (
    LabelChannel("range", "<f4", 1, math.inf, "distance along the pixel's ray, metres"),
    LabelChannel(
        "normal", "<f4", 3, 0.0, "unit normal of the facet, towards the ray's origin, mirror frame"
    ),
    LabelChannel("point", "<f4", 3, math.nan, "point that the ray meets, metres, world frame"),
    LabelChannel("ids", "<u2", 1, 0, "number of the object, from 1; 0: nothing"),
    LabelChannel(
        "classes", "<u2", 1, 0, "number of the object's class, from 1; 0: nothing; 65535: sky"
    ),
    LabelChannel(
        "agreement", "u1", 1, 0, "samples of the pixel that meet the same object, 255: all"
    ),
    LabelChannel(
        "flow", "<f4", 2, math.nan, "displacement of the point's image, px: u, v; nan where unknown"
    ),
    LabelChannel("valid", "u1", 1, 0, "1 where the pixel's centre has a ray, else 0"),
)
SKY_CLASS = 65535
"""Class of pixels whose rays meet nothing, in a world whose sky differs by direction. It belongs to
no object: the number of the object is 0, the range infinite."""
LABEL_CHANNELS = {channel.name: channel for channel in _CHANNELS}


def parse_channels(names: tuple[str, ...]) -> tuple[LabelChannel, ...]:
    """Channels of names, each once, in the order of the table.

    Raises:
        DomainError: A name is no channel's, or stands twice.
    """
    unknown = [name for name in names if name not in LABEL_CHANNELS]
    if unknown:
        allowed = ", ".join(LABEL_CHANNELS)
        raise DomainError(f"there is no channel {unknown[0]!r}: the channels are {allowed}")
    if len(set(names)) < len(names):
        raise DomainError(f"a channel stands twice: {', '.join(names)}")
    return tuple(channel for channel in _CHANNELS if channel.name in names)


def count_bytes(channels: Collection[LabelChannel], height_px: int, width_px: int) -> int:
    """Size of the arrays of channels of one image."""
    per_pixel = sum(np.dtype(channel.dtype).itemsize * channel.depth for channel in channels)
    return height_px * width_px * per_pixel
