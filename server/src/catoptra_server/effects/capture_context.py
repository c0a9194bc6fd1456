"""Inputs of an image effect beside the image and the camera."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.camera_state import ZERO_SEED, NoiseSeed


@dataclass(frozen=True, slots=True, eq=False)
class CaptureContext:
    """Noise seed and ranges of one exposure."""

    noise_seed: NoiseSeed = ZERO_SEED
    range_m: npt.NDArray[np.float32] | None = None
    """Range at each pixel centre from the effective viewpoint, (h, w).

    inf where a pixel shows the background, and outside the mirror. None where no enabled effect
    needs ranges.
    """


EMPTY_CONTEXT = CaptureContext()
