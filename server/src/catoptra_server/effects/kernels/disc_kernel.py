"""The kernels of uniform discs on a grid of pixels, by their variance.

A pixel of the picture is already the mean over its square, so a disc is laid over squares of
constant light: a pixel's weight is its share of the disc's area. That adds the squares' own spread,
1/12 px^2 for large discs; therefore the disc that is laid is a little smaller, such that the
kernel's variance along each axis is that of the disc that is meant, d^2 / 16, exactly. A disc
within its pixel would change nothing; by the variance its light still reaches the four neighbours.
Weights are 0 or more and sum to 1: no light is lost, and none overshoots. Between two rows of the
table, which are straight mixtures, sum and variance stay exact. Source: derived here; the area
is the integral of the circle's ordinate, cut at the square's sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.effect import Real
from catoptra_server.effects.kernels.symmetric_kernels import (
    num_offset_pairs,
    offset_pairs,
    pair_multiplicities,
)

# Rows of the table a px^2 of variance; a kink of a weight between two rows is cut by 1e-4.
ROWS_PER_PX2 = 64
# Steps of the diameter of the disc that is laid.
_DIAMETER_STEP_PX = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class DiscKernelTable:
    """Weights of kernels with growing variance.

    reach_px: how far the widest reaches. weights: (rows, pairs), row n for a variance of n /
    ROWS_PER_PX2.
    """

    half_width_px: int
    weights: Floats

    def half_width_up_to_row(self, row: float) -> int:
        """Return how far kernels up to a row reach."""
        return _half_width(self.weights[: math.ceil(row) + 1], self.half_width_px)

    def interpolate(self, row: npt.NDArray[Real], half_width_px: int) -> npt.NDArray[Real]:
        """Return the (pairs, ...) weights of (...) rows, between two rows both; up to a reach."""
        row = np.minimum(row, row.dtype.type(len(self.weights) - 1))
        below = np.minimum(row.astype(np.intp), len(self.weights) - 2)
        share = row - below.astype(row.dtype)
        weights = self.weights[:, : num_offset_pairs(half_width_px)].T.astype(row.dtype)
        steps = np.diff(weights, axis=1)
        mixed = np.zeros((len(weights), *row.shape), dtype=row.dtype)
        for pair, (lower, step) in enumerate(zip(weights, steps, strict=True)):
            mixed[pair] = lower.take(below) + share * step.take(below)
        return mixed

    def to_texture(self) -> npt.NDArray[np.float32]:
        """Return the weights as shaders read them, (rows, pairs, 1)."""
        return _weights_texture(self)


def table_row(diameter_px: Floats) -> Floats:
    """Return the row, with its fraction, of the kernel of a disc."""
    row: Floats = (ROWS_PER_PX2 / 16.0) * np.square(diameter_px)
    return row


@lru_cache(maxsize=8)
def disc_kernel_table(max_diameter_px: float) -> DiscKernelTable:
    """Return the kernels of all discs up to a diameter."""
    rows = math.ceil(float(table_row(np.array(max_diameter_px)))) + 2
    variance = np.arange(rows) / ROWS_PER_PX2
    # A disc of 1 px changes nothing; one of largest_px + 1 is always wider than what is meant.
    laid = np.arange(1.0, max(max_diameter_px, 1.0) + 1.0 + _DIAMETER_STEP_PX, _DIAMETER_STEP_PX)
    reach = math.ceil(0.5 * laid[-1] - 0.5)
    shares = disc_area_fractions(laid, reach)
    spread = _variances(shares, reach)
    weights = np.stack([np.interp(variance, spread, share) for share in shares.T], axis=-1)
    reach = _half_width(weights, reach)
    weights = np.ascontiguousarray(weights[:, : num_offset_pairs(reach)])
    weights.setflags(write=False)
    return DiscKernelTable(reach, weights)


def _half_width(weights: Floats, half_width_px: int) -> int:
    """Return how far (rows, pairs) weights reach: 0 beyond."""
    return max(
        i
        for (i, _), column in zip(offset_pairs(half_width_px), weights.T, strict=True)
        if column.any()
    )


@lru_cache(maxsize=8)
def _weights_texture(table: DiscKernelTable) -> npt.NDArray[np.float32]:
    return table.weights.astype(np.float32)[..., None]


def disc_area_fractions(diameter_px: Floats, half_width_px: int) -> Floats:
    """Return the (n, pairs) shares of discs' areas that lie in one pixel of each pair."""
    radius = 0.5 * np.asarray(diameter_px)[:, None]
    i, j = np.array(list(offset_pairs(half_width_px))).T.astype(np.float64)
    corners = [
        sign * _corner_area(i + dx, j + dy, radius)
        for dx, dy, sign in ((0.5, 0.5, 1), (-0.5, 0.5, -1), (0.5, -0.5, -1), (-0.5, -0.5, 1))
    ]
    area: Floats = sum(corners, start=np.zeros(1)) / (math.pi * np.square(radius))
    # Differences of areas that are all of the disc's leave their rounding.
    return np.where(area > 1e-12, area, 0.0)


def _corner_area(x: Floats, y: Floats, radius: Floats) -> Floats:
    """Return the area of a disc between the axes and (x, y), odd in both."""
    sign = np.sign(x) * np.sign(y)
    x, y = np.minimum(np.abs(x), radius), np.minimum(np.abs(y), radius)
    # Up to there the circle lies above y.
    flat = np.minimum(np.sqrt(np.square(radius) - np.square(y)), x)
    area: Floats = y * flat + _circle_integral(x, radius) - _circle_integral(flat, radius)
    return sign * area


def _circle_integral(x: Floats, radius: Floats) -> Floats:
    """Return the integral of the circle's ordinate from 0 to x."""
    chord = np.sqrt(np.maximum(np.square(radius) - np.square(x), 0.0))
    area: Floats = 0.5 * (x * chord + np.square(radius) * np.arcsin(np.minimum(x / radius, 1.0)))
    return area


def _variances(weights: Floats, half_width_px: int) -> Floats:
    """Return the (n,) variances along an axis of kernels of (n, pairs) weights."""
    squares = np.array([0.5 * (i * i + j * j) for i, j in offset_pairs(half_width_px)])
    variances: Floats = weights @ (squares * pair_multiplicities(half_width_px))
    return variances
