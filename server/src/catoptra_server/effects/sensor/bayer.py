"""Bayer mosaic: each pixel measures one colour, the other two are interpolated.

Pattern RGGB: row 0 is R G R G, row 1 is G B G B. The noise of a pixel's three colours is
independent, so keeping one of them here equals measuring only that one. Demosaicing is bilinear:
the mean of the nearest pixels of a colour; at the border the image is mirrored about its last
pixel, which keeps the pattern. A pixel measures at most its full well. Source: Bayer 1976, US
patent 3 971 065. Domain: images of at least 2 x 2 px. Criterion: a mean lies between its parts, so
no pixel changes by more than the difference between the brightest light and black.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    UNCHANGED,
    CaptureContext,
    EffectBound,
    EffectType,
    Gains,
    Real,
    SceneSummary,
)
from catoptra_server.effects.kernels.grey_levels import grey_level

_EVEN, _ODD = slice(0, None, 2), slice(1, None, 2)


@dataclass(frozen=True, slots=True)
class Bayer:
    """RGGB mosaic with bilinear demosaicing. No parameters."""

    name: ClassVar[str] = "Bayer"
    changes_scene: ClassVar[bool] = False
    # A mean of wells that are clipped before: no light above white becomes darker.
    gains: ClassVar[Gains] = UNCHANGED
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Grey level of the brightest light."""
        # A single bright pixel on black loses two of its colours: no smaller bound holds.
        value = grey_level(summary.picture_radiance)
        return EffectBound(value, "a pixel may be between black and the brightest light")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: a mean is not brighter than its brightest pixel."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Measure one colour per pixel and interpolate the others."""
        # Of a full well, where no effect before has said so.
        raw = _measure(np.minimum(image, image.dtype.type(1.0)))
        # "reflect" repeats no pixel: the neighbour outside has the colour that the pattern expects.
        padded = np.pad(raw, 1, mode="reflect")
        horizontal = image.dtype.type(0.5) * (padded[1:-1, :-2] + padded[1:-1, 2:])
        vertical = image.dtype.type(0.5) * (padded[:-2, 1:-1] + padded[2:, 1:-1])
        above, below = padded[:-2], padded[2:]
        diagonal = image.dtype.type(0.25) * (
            above[:, :-2] + above[:, 2:] + below[:, :-2] + below[:, 2:]
        )
        cross = image.dtype.type(0.5) * (horizontal + vertical)
        return _assemble_channels(raw, horizontal, vertical, diagonal, cross)


def _measure(image: npt.NDArray[Real]) -> npt.NDArray[Real]:
    """Radiance that each pixel measures through its filter, (h, w)."""
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
    """Choose each pixel's colours, (h, w, 3), from means over its neighbours."""
    rgb = np.zeros((*raw.shape, 3), dtype=raw.dtype)
    # A green pixel has red beside and blue above in even rows, and the reverse in odd rows.
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
