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
_FEWEST_INSTANTS, MOST_INSTANTS = 2, 64
_STEP_PX, _ROW_STEP_PX = 1.0, 0.25

Weights = npt.NDArray[np.float32]  # (rows,)


@dataclass(frozen=True, slots=True)
class Shutter:
    """How long each row is exposed, how long from the first row to the last, in how many slots."""

    exposure_s: float
    readout_s: float
    instants: int

    @classmethod
    def within(
        cls, exposure_s: float, readout_s: float, *, spread_px: float, carried_px: float
    ) -> Shutter:
        """Return the shutter with as many slots as motion needs.

        spread_px: the largest way in the exposure; carried_px: in the readout, first row to last.
        """
        wanted = spread_px / _STEP_PX + carried_px / _ROW_STEP_PX
        return cls(
            exposure_s, readout_s, max(math.ceil(min(wanted, MOST_INSTANTS)), _FEWEST_INSTANTS)
        )

    @property
    def times_s(self) -> tuple[float, ...]:
        """Return the middles of the slots, seconds from the pose."""
        whole_s = self.exposure_s + self.readout_s
        return tuple(((i + 0.5) / self.instants - 0.5) * whole_s for i in range(self.instants))

    def weights(self, rows: int) -> npt.NDArray[np.float32]:
        """Return the (instants, rows) share of each slot in each row."""
        whole_s = self.exposure_s + self.readout_s
        middle_s = self.readout_s * ((np.arange(rows) + 0.5) / rows - 0.5)
        edges_s = (np.arange(self.instants + 1) / self.instants - 0.5) * whole_s
        if self.exposure_s == 0.0:
            slot = np.searchsorted(edges_s[1:-1], middle_s, side="right")
            return np.equal.outer(np.arange(self.instants), slot).astype(np.float32)
        begin_s, end_s = middle_s - 0.5 * self.exposure_s, middle_s + 0.5 * self.exposure_s
        within_s = np.diff(np.clip(edges_s[:, None], begin_s, end_s), axis=0)
        shares: npt.NDArray[np.float32] = (within_s / self.exposure_s).astype(np.float32)
        return shares
