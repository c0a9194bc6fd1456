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

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import GREY_LEVELS, EffectBound, EffectType, Real, Uniforms
from catoptra_server.effects.kernels.grey_levels import grey_level
from catoptra_server.effects.scene_summary import SceneSummary

_EVEN, _ODD = slice(0, None, 2), slice(1, None, 2)


@dataclass(frozen=True, slots=True)
class Bayer:
    """No numbers: RGGB, bilinear."""

    name: ClassVar[str] = "Bayer"
    unit: ClassVar[str] = GREY_LEVELS
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return how far the brightest light is from black."""
        value = grey_level(summary.max_radiance)
        return EffectBound(value, "a pixel may lie between black and the brightest light")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: no mean exceeds what it is of."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the picture of one measured colour a pixel."""
        raw = mosaic(image)
        around = np.pad(raw, 1, mode="reflect")
        across = image.dtype.type(0.5) * (around[1:-1, :-2] + around[1:-1, 2:])
        along = image.dtype.type(0.5) * (around[:-2, 1:-1] + around[2:, 1:-1])
        above, below = around[:-2], around[2:]
        corners = image.dtype.type(0.25) * (
            above[:, :-2] + above[:, 2:] + below[:, :-2] + below[:, 2:]
        )
        plus = image.dtype.type(0.5) * (across + along)
        return _assemble_channels(raw, across, along, corners, plus)

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return nothing."""
        return {}


def mosaic(image: npt.NDArray[Real]) -> npt.NDArray[Real]:
    """Return the (h, w) light that each pixel measures through its filter."""
    raw = image[..., 1].copy()
    raw[::2, ::2] = image[::2, ::2, 0]
    raw[1::2, 1::2] = image[1::2, 1::2, 2]
    return raw


def _assemble_channels(
    raw: npt.NDArray[Real],
    horizontal_mean: npt.NDArray[Real],
    vertical_mean: npt.NDArray[Real],
    diagonal_mean: npt.NDArray[Real],
    cross_mean: npt.NDArray[Real],
) -> npt.NDArray[Real]:
    """Return (h, w, 3) of means over the neighbours left and right, above and below, diagonal."""
    rgb = np.zeros((*raw.shape, 3), dtype=raw.dtype)
    for (rows, columns), (red, green, blue) in (
        ((_EVEN, _EVEN), (raw, cross_mean, diagonal_mean)),
        ((_EVEN, _ODD), (horizontal_mean, raw, vertical_mean)),
        ((_ODD, _EVEN), (vertical_mean, raw, horizontal_mean)),
        ((_ODD, _ODD), (diagonal_mean, cross_mean, raw)),
    ):
        for channel, values in enumerate((red, green, blue)):
            rgb[rows, columns, channel] = values[rows, columns]
    return rgb


EFFECT_TYPE = EffectType("Bayer", Bayer)
