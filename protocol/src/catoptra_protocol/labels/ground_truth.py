"""The ground truth of one image: its channels and its objects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

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
