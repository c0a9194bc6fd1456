"""Requests for labels: channels of what rays meet, by numbers of objects and classes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.ray_table import RayTable

LabelNumbers = npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True, eq=False)
class LabelTables:
    """Numbers of objects and classes."""

    triangle_numbers: LabelNumbers
    """(n,) number of the object of each triangle of the static scene."""
    object_numbers: LabelNumbers
    """(o,) number of each dynamic object of an exposure, in its order."""
    class_table: LabelNumbers
    """(65536,) number of the class of each object's number."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelRequest:
    """Labels that are wanted of an image."""

    channels: frozenset[str]
    """Names of the channels."""
    tables: LabelTables
    centres: RayTable
    """Rays of the pixels' centres: one sample a pixel."""
