"""Masks read from COCO's strings of run lengths, as pycocotools does."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Bools


def mask_from_string(text: str, height_px: int, width_px: int) -> Bools:
    """(h, w) mask of a string."""
    lengths: list[int] = []
    value, shift = 0, 0
    for bits in (ord(character) - 48 for character in text):
        assert 0 <= bits < 64, "a character of COCO's strings"
        value |= (bits & 0x1F) << shift
        shift += 5
        if not bits & 0x20:
            value -= (1 << shift) if bits & 0x10 else 0
            lengths.append(value + lengths[-2] if len(lengths) > 2 else value)
            value, shift = 0, 0
    inside = np.arange(len(lengths)) % 2 == 1
    return np.repeat(inside, lengths).reshape(width_px, height_px).T
