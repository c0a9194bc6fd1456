"""Exposure and readout times: time samples of a long exposure, and their weights in each row.

An image of a moving scene is the mean, in linear light, of sharp images: row v of h is exposed from
t_v - T/2 to t_v + T/2, T the exposure time, t_v = R ((v + 1/2) / h - 1/2), R the readout time; both
are centred on the pose. The whole time, T + R, is divided into equal slots, and one sharp image is
rendered at the centre of each, with camera, objects, occlusion and shadows of that time. A row's
weight of a slot is the fraction of the row's exposure within the slot; the weights sum to 1, so no
light is lost.

Error: within a slot everything stands still. Steps of a pixel during the exposure leave less than a
grey level of rms against 64 time samples, since pixels are means already; a row that shows a single
slot is off by up to half a slot, so the displacement during the readout counts four times.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from catoptra_protocol.slotted_dataclass import dataclass

# One time sample alone would be a sharp image, however far objects move.
_MIN_TIME_SAMPLES, MAX_TIME_SAMPLES = 2, 64
# Pixels between time samples; a quarter for rows with one slot alone (see above).
_MAX_STEP_PX, _MAX_ROW_STEP_PX = 1.0, 0.25

RowWeights = npt.NDArray[np.float32]  # (rows,)


@dataclass(frozen=True, slots=True)
class Shutter:
    """Exposure and readout times, with the displacement that the time samples have to resolve."""

    exposure_s: float
    """Exposure time of a row."""
    readout_s: float
    """Time from the first row's exposure to that of a row after the last; 0: a global shutter."""
    num_steps: float
    """Displacement during both times, in steps that a slot may have; any number."""
    max_time_samples: int = MAX_TIME_SAMPLES
    """Limit of the number of slots; fewer than there are steps blur the image in steps."""

    def with_exposure(self, exposure_s: float, displacement_px: float) -> Shutter:
        """Shutter with an exposure time, for the largest displacement in that time."""
        num_steps = self.num_steps + displacement_px / _MAX_STEP_PX
        return replace(self, exposure_s=exposure_s, num_steps=num_steps)

    def with_readout(self, readout_s: float, displacement_px: float) -> Shutter:
        """Shutter with a readout time, for the displacement from the first row to the last."""
        num_steps = self.num_steps + displacement_px / _MAX_ROW_STEP_PX
        return replace(self, readout_s=readout_s, num_steps=num_steps)

    @property
    def num_time_samples(self) -> int:
        """Number of slots, each one rendering."""
        # Rounded here and not in each step: two effects that need 1.5 slots each need 3, not 4.
        return max(math.ceil(min(self.num_steps, self.max_time_samples)), _MIN_TIME_SAMPLES)

    @property
    def times_s(self) -> tuple[float, ...]:
        """Centres of the slots, seconds from the pose."""
        total_s, count = self.exposure_s + self.readout_s, self.num_time_samples
        return tuple(((i + 0.5) / count - 0.5) * total_s for i in range(count))

    def row_weights(self, num_rows: int) -> npt.NDArray[np.float32]:
        """(num_time_samples, num_rows) weight of each slot in each row."""
        total_s, count = self.exposure_s + self.readout_s, self.num_time_samples
        centre_s = self.readout_s * ((np.arange(num_rows) + 0.5) / num_rows - 0.5)
        edges_s = (np.arange(count + 1) / count - 0.5) * total_s
        # A row of no duration shows exactly one slot; the fraction below would be 0 / 0.
        if self.exposure_s == 0.0:
            slot = np.searchsorted(edges_s[1:-1], centre_s, side="right")
            return np.equal.outer(np.arange(count), slot).astype(np.float32)
        begin_s, end_s = centre_s - 0.5 * self.exposure_s, centre_s + 0.5 * self.exposure_s
        within_s = np.diff(np.clip(edges_s[:, None], begin_s, end_s), axis=0)
        fractions: npt.NDArray[np.float32] = (within_s / self.exposure_s).astype(np.float32)
        return fractions


# Start of the effects that lengthen an exposure: neither time lasts yet.
INSTANTANEOUS = Shutter(0.0, 0.0, 0.0)
