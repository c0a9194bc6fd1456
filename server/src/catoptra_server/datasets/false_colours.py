"""Channels of ground truth as pictures for people, and boxes of objects over a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Pixels = npt.NDArray[np.uint8]

# Turns of the golden ratio: neighbouring numbers get far colours.
_GOLDEN = 0.6180339887498949
# A range of this many metres has half the brightness.
_HALF_RANGE_M = 2.0


def colour_channel(name: str, array: npt.NDArray[Any]) -> Pixels:
    """(h, w, 3) picture of a channel; black where there is nothing."""
    match name:
        case "range":
            grey = np.where(np.isfinite(array), 1.0 / (1.0 + array / _HALF_RANGE_M), 0.0)
            return _to_pixels(np.repeat(grey[..., None], 3, axis=-1))
        case "normal":
            # Nothing is a zero normal, which would be grey.
            is_surface = np.any(array != 0.0, axis=-1, keepdims=True)
            return _to_pixels(np.where(is_surface, 0.5 + 0.5 * array.astype(float), 0.0))
        case "point":
            return _to_pixels(np.nan_to_num(array.astype(float) % 1.0, nan=0.0))
        case "flow":
            return _colour_flow(array)
        case "ids" | "classes":
            return _colour_numbers(array)
        case "agreement":
            return _to_pixels(np.repeat(array[..., None] / 255.0, 3, axis=-1))
        case _:
            return _to_pixels(np.repeat(array[..., None].astype(float), 3, axis=-1))


def colour_of_number(number: int) -> tuple[int, int, int]:
    """Colour of an object or class; black of 0, which is nothing."""
    red, green, blue = _colour_numbers(np.array([number])).reshape(3).tolist()
    return red, green, blue


def draw_boxes(rgb: Pixels, objects: Sequence[dict[str, Any]]) -> Pixels:
    """Picture with the box of each object, in the colour that the object has in `ids`."""
    picture = rgb.copy()
    height, width = picture.shape[:2]
    for one in objects:
        x, y, box_width, box_height = one["box_px"]
        right, bottom = min(x + box_width, width) - 1, min(y + box_height, height) - 1
        colour = colour_of_number(one["id"])
        picture[[y, bottom], x : right + 1] = colour
        picture[y : bottom + 1, [x, right]] = colour
    return picture


def _colour_numbers(array: npt.NDArray[Any]) -> Pixels:
    hue = array.astype(float) * _GOLDEN % 1.0
    colours = _rgb_from_hue(hue, np.ones_like(hue))
    return np.where((array == 0)[..., None], np.uint8(0), colours).astype(np.uint8)


def _colour_flow(array: npt.NDArray[Any]) -> Pixels:
    is_known = np.isfinite(array).all(axis=-1)
    u, v = (np.where(is_known, array[..., axis], 0.0).astype(float) for axis in (0, 1))
    length = np.hypot(u, v)
    # The longest of most pixels is full brightness: single ones at the rim are far longer.
    limit = float(np.percentile(length[is_known], 95.0)) if is_known.any() else 1.0
    brightness = np.minimum(length / (limit or 1.0), 1.0)
    hue = np.arctan2(v, u) / (2.0 * math.pi) % 1.0
    # Pixels that stand still are grey, unlike those without a flow.
    grey = np.where(is_known, 40, 0).astype(np.uint8)[..., None]
    return np.maximum(_rgb_from_hue(hue, brightness), grey)


def _rgb_from_hue(hue: npt.NDArray[Any], value: npt.NDArray[Any]) -> Pixels:
    """(..., 3) colours of hues in turns, fully saturated."""
    offsets = np.array((0.0, 2.0 / 3.0, 1.0 / 3.0))
    ramps = np.abs(((hue[..., None] + offsets) % 1.0) * 6.0 - 3.0) - 1.0
    return _to_pixels(np.clip(ramps, 0.0, 1.0) * value[..., None])


def _to_pixels(colours: npt.NDArray[Any]) -> Pixels:
    return np.asarray(np.round(255.0 * np.clip(colours, 0.0, 1.0)), dtype=np.uint8)
