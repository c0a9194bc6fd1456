"""Optical flow of the pixels of one exposure: their points, and the projection of the other one."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.ray_table import Float32s

NO_MOTION = -1
"""Index of the motion of what stays where it is."""


@dataclass(frozen=True, slots=True, eq=False)
class FlowTables:
    """Points of an image, and a camera as tables by the angle from its axis."""

    points: Float32s
    """(h, w, 3) points that the pixels show, world frame; nan where they show none."""
    ids: npt.NDArray[np.uint16]
    """(h, w) numbers of the objects that these belong to."""
    motions: Mapping[int, Pose]
    """Motion of each moving object by number, world there from world here."""
    gone: Collection[int]
    """Numbers of objects that the other exposure lacks."""
    places: Floats
    """(n,) evenly spaced places of the camera's domain: t / (1 + t), t = tan(angle / 2)."""
    radius_px: Floats
    """(n,) image radii."""
    axes: Floats
    """(2, 2) unit displacements in the image, columns, of the azimuths of x and of y."""
    centre_px: tuple[float, float]
    origin_r: Floats | None = None
    """(n,) distances of the rays' origins from the axis, metres; None: all at the viewpoint."""
    origin_z: Floats | None = None
    """(n,) their positions along the axis."""
