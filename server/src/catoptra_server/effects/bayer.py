"""Bayer mosaic: each pixel measures one colour, the others come from its neighbours.

Pattern RGGB: row 0 is R G R G, row 1 is G B G B. The noise of the three colours of a pixel is
independent, so keeping one of them here is the same as having measured only that one. Demosaicing
is bilinear: the mean of the nearest pixels of a colour; beyond the border the picture is mirrored
about its last pixel, which keeps the pattern. Source: Bayer 1976, US patent 3 971 065. Domain:
pictures of at least 2 x 2 px. Criterion: a mean lies between what it is of, so no pixel changes by
more than the brightest light has above black.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.effect import GREY_LEVELS, Bound, Kind, Real, Uniforms
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.effects.shared.grey_levels import grey_level

_EVEN, _ODD = slice(0, None, 2), slice(1, None, 2)


@dataclass(frozen=True, slots=True)
class Bayer:
    """No numbers: RGGB, bilinear."""

    name: ClassVar[str] = "Bayer"
    unit: ClassVar[str] = GREY_LEVELS
    uses_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return how far the brightest light is from black."""
        value = grey_level(summary.largest_radiance)
        return Bound(value, "a pixel may lie between black and the brightest light")

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: no mean exceeds what it is of."""
        return summary

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the picture of one measured colour a pixel."""
        raw = mosaic(light)
        around = np.pad(raw, 1, mode="reflect")
        across = light.dtype.type(0.5) * (around[1:-1, :-2] + around[1:-1, 2:])
        along = light.dtype.type(0.5) * (around[:-2, 1:-1] + around[2:, 1:-1])
        above, below = around[:-2], around[2:]
        corners = light.dtype.type(0.25) * (
            above[:, :-2] + above[:, 2:] + below[:, :-2] + below[:, 2:]
        )
        plus = light.dtype.type(0.5) * (across + along)
        return _assembled(raw, across, along, corners, plus)

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return nothing."""
        return {}


def mosaic(light: npt.NDArray[Real]) -> npt.NDArray[Real]:
    """Return the (h, w) light that each pixel measures through its filter."""
    raw = light[..., 1].copy()
    raw[::2, ::2] = light[::2, ::2, 0]
    raw[1::2, 1::2] = light[1::2, 1::2, 2]
    return raw


def _assembled(
    raw: npt.NDArray[Real],
    across: npt.NDArray[Real],
    along: npt.NDArray[Real],
    corners: npt.NDArray[Real],
    plus: npt.NDArray[Real],
) -> npt.NDArray[Real]:
    """Return (h, w, 3) of means over the neighbours left and right, above and below, diagonal."""
    rgb = np.zeros((*raw.shape, 3), dtype=raw.dtype)
    for (rows, columns), (red, green, blue) in (
        ((_EVEN, _EVEN), (raw, plus, corners)),
        ((_EVEN, _ODD), (across, raw, along)),
        ((_ODD, _EVEN), (along, raw, across)),
        ((_ODD, _ODD), (corners, plus, raw)),
    ):
        for channel, values in enumerate((red, green, blue)):
            rgb[rows, columns, channel] = values[rows, columns]
    return rgb


KIND = Kind("Bayer", Bayer)
