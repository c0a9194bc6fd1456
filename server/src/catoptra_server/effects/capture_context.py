"""What an effect may know of an exposure beside its light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_server.capture.noise_seed import ZERO_SEED, NoiseSeed


@dataclass(frozen=True, slots=True, eq=False)
class CaptureContext:
    """An exposure as effects know it.

    range_m: (h, w) float32 from the effective viewpoint of what the middle of each pixel sees, inf
    where nothing is met, and beside the mirror. None where no effect of the frame uses it, and
    where it lies on a device as the texture `range_m`.
    """

    noise_seed: NoiseSeed = ZERO_SEED
    range_m: npt.NDArray[np.float32] | None = None


EMPTY_CONTEXT = CaptureContext()
