"""What an effect may know of an exposure beside its light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_server.effects.frame_key import UNKEYED, FrameKey
from catoptra_server.scene.motion import AT_REST, Twist

# The mover of whatever does not move in the world: scene and background.
SCENE = 0


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """What the middle of each pixel sees.

    range_m: (h, w) float32 from the effective viewpoint, inf where nothing is met, and beside the
    mirror. mover: (h, w) float32 whole numbers: SCENE, or n for the exposure's n-th body from 1.
    """

    range_m: npt.NDArray[np.float32]
    mover: npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """An exposure as effects know it.

    motion: of each mover as it is seen from the viewpoint: told at the viewpoint, in the axes of
    the mirror frame, the camera's own motion taken off; a point at x moves by linear + angular x x.
    geometry: None where no effect of the frame uses it, and where it lies on a device as the
    texture `geometry` (range, mover).
    """

    key: FrameKey = UNKEYED
    motion: tuple[Twist, ...] = (AT_REST,)
    geometry: Geometry | None = None


NOTHING_KNOWN = Capture()
