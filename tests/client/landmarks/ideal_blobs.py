"""Ideal blobs: the blobs of a beacon or a box at a range with perfect labels."""

from __future__ import annotations

import math

import numpy as np

from catoptra_client.landmarks.blobs import Blob
from catoptra_client.unwarp import CylinderGeometry


def make_blob(
    cylinder: CylinderGeometry,
    colour: str,
    *,
    heights_m: tuple[float, float],
    width_m: float,
    range_m: float,
    azimuth_rad: float = 0.0,
    viewpoint_height_m: float = 0.6,
) -> Blob:
    """Blob of an upright rectangle that faces the viewpoint."""
    bottom, top = (
        cylinder.row_from_slope((viewpoint_height_m - height) / range_m) for height in heights_m
    )
    column = float(cylinder.column_from_azimuth(np.array(azimuth_rad)))
    half = math.atan(0.5 * width_m / range_m) / cylinder.azimuth_per_column_rad
    pixels = max(round(2 * half * (bottom - top)), 1)
    row = 0.5 * (top + bottom)
    return Blob(colour, pixels, column, row, column - half, column + half, top, bottom)
