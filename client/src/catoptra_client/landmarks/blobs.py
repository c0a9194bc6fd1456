"""Connected regions of one colour in a labelled cylinder, whole across the azimuth seam."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from catoptra_client.landmarks.classifier import COLOUR_CODES
from catoptra_client.landmarks.histogram import UInt8Array

# On one thread the default takes three times as long. Measured in
# tests/measurements/detection_time.py.
_CCL_ALGORITHM = cv2.CCL_GRANA

Ints = npt.NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class Blob:
    """A region of one colour: pixel count, centroid, and the edges of its box.

    Columns and rows are continuous, pixel centres at +0.5. Across the seam the columns run on
    beyond the picture's width: right > columns.
    """

    colour: str
    num_pixels: int
    column: float
    row: float
    left: float
    right: float
    top: float
    bottom: float

    @property
    def width(self) -> float:
        """Return the box's width in columns."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Return the box's height in rows."""
        return self.bottom - self.top


def blobs_from_labels(labels: UInt8Array, *, min_pixels: int) -> tuple[Blob, ...]:
    """Return the blobs of (rows, columns) colour codes that have at least `min_pixels`."""
    found = [
        blob
        for colour, code in COLOUR_CODES.items()
        for blob in _find_blobs(colour, cv2.inRange(labels, code, code))
    ]
    return tuple(blob for blob in found if blob.num_pixels >= min_pixels)


def _find_blobs(colour: str, mask: UInt8Array) -> list[Blob]:
    count, regions, stats, centroids = cv2.connectedComponentsWithStatsWithAlgorithm(
        mask, 8, cv2.CV_32S, _CCL_ALGORITHM
    )
    blobs: dict[int, Blob] = {}
    for i in range(1, count):  # 0 is the background
        left, top, width, height, pixels = stats[i].tolist()
        column, row = (centroids[i] + 0.5).tolist()
        blobs[i] = Blob(colour, pixels, column, row, left, left + width, top, top + height)
    for first, last in _find_seam_pairs(np.asarray(regions)):
        _join_across_seam(blobs, first, last, columns=mask.shape[1])
    return list({id(blob): blob for blob in blobs.values()}.values())


def _find_seam_pairs(regions: Ints) -> Iterator[tuple[int, int]]:
    """Yield pairs of regions in the first and the last column that touch, diagonals included."""
    first, last = regions[:, 0], regions[:, -1]
    if not (first.any() and last.any()):
        return
    padded = np.pad(last, 1)
    rows = len(first)
    pairs = {
        pair
        for shift in range(3)
        for pair in zip(first.tolist(), padded[shift : shift + rows].tolist(), strict=True)
    }
    yield from sorted(pair for pair in pairs if all(pair))


def _join_across_seam(blobs: dict[int, Blob], first: int, last: int, *, columns: int) -> None:
    """Let both names stand for one blob: the last column's, continued by the first column's.

    A region that already runs around the whole turn, or is joined already, stays as it is.
    """
    head, tail = blobs[last], blobs[first]
    if head is tail:
        return
    joined = _merge(head, tail if tail.right > columns else _shift(tail, columns))
    for name, blob in blobs.items():
        if blob is head or blob is tail:
            blobs[name] = joined


def _shift(blob: Blob, columns: int) -> Blob:
    return Blob(
        blob.colour,
        blob.num_pixels,
        blob.column + columns,
        blob.row,
        blob.left + columns,
        blob.right + columns,
        blob.top,
        blob.bottom,
    )


def _merge(one: Blob, other: Blob) -> Blob:
    pixels = one.num_pixels + other.num_pixels
    share = other.num_pixels / pixels
    return Blob(
        one.colour,
        pixels,
        one.column + share * (other.column - one.column),
        one.row + share * (other.row - one.row),
        min(one.left, other.left),
        max(one.right, other.right),
        min(one.top, other.top),
        max(one.bottom, other.bottom),
    )
