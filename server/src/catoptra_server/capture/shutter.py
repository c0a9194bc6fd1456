"""An exposure that lasts: at which instants it is drawn, and how much each counts in which row.

A picture of what moves is the mean, in linear light, of sharp pictures: row v of h is exposed from
t_v - T/2 to t_v + T/2, T the exposure, t_v = R ((v + 1/2) / h - 1/2), R the readout; both are
centred on the pose. The whole time, T + R, is cut into equal slots, drawn in their middles with
everything where it is then: the camera, bodies, what they hide, and their shadows. A row's weight
of a slot is the share of its exposure that falls into it; they sum to 1, so no light is lost.

Error: what is shown stands still within a slot. Steps of a pixel while the shutter is open leave
less than a grey level of rms against 64 instants, since pixels are means already; a row that shows
one instant alone is off by up to half a slot, so what rows are carried counts four times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

# One instant alone would be a sharp picture, however far things move.
_MIN_TIME_SAMPLES, MAX_TIME_SAMPLES = 2, 64
_MAX_STEP_PX, _MAX_ROW_STEP_PX = 1.0, 0.25

RowWeights = npt.NDArray[np.float32]  # (rows,)


@dataclass(frozen=True, slots=True)
class Shutter:
    """How long each row is exposed, how long from the first row to the last, in how many slots."""

    exposure_s: float
    readout_s: float
    num_time_samples: int

    @classmethod
    def from_motion(
        cls,
        exposure_s: float,
        readout_s: float,
        *,
        exposure_displacement_px: float,
        readout_displacement_px: float,
    ) -> Shutter:
        """Return the shutter with as many slots as motion needs.

        spread_px: the largest way in the exposure; carried_px: in the readout, first row to last.
        """
        wanted = (
            exposure_displacement_px / _MAX_STEP_PX + readout_displacement_px / _MAX_ROW_STEP_PX
        )
        return cls(
            exposure_s, readout_s, max(math.ceil(min(wanted, MAX_TIME_SAMPLES)), _MIN_TIME_SAMPLES)
        )

    @property
    def times_s(self) -> tuple[float, ...]:
        """Return the middles of the slots, seconds from the pose."""
        whole_s = self.exposure_s + self.readout_s
        return tuple(
            ((i + 0.5) / self.num_time_samples - 0.5) * whole_s
            for i in range(self.num_time_samples)
        )

    def row_weights(self, num_rows: int) -> npt.NDArray[np.float32]:
        """Return the (instants, rows) share of each slot in each row."""
        whole_s = self.exposure_s + self.readout_s
        middle_s = self.readout_s * ((np.arange(num_rows) + 0.5) / num_rows - 0.5)
        edges_s = (np.arange(self.num_time_samples + 1) / self.num_time_samples - 0.5) * whole_s
        if self.exposure_s == 0.0:
            slot = np.searchsorted(edges_s[1:-1], middle_s, side="right")
            return np.equal.outer(np.arange(self.num_time_samples), slot).astype(np.float32)
        begin_s, end_s = middle_s - 0.5 * self.exposure_s, middle_s + 0.5 * self.exposure_s
        within_s = np.diff(np.clip(edges_s[:, None], begin_s, end_s), axis=0)
        shares: npt.NDArray[np.float32] = (within_s / self.exposure_s).astype(np.float32)
        return shares
