"""Lengths, positions and colours of world files."""

from __future__ import annotations

import numpy as np

from catoptra_server.config.section_reader import SectionReader, Vector
from catoptra_server.world.world_description import Rgb, linear_from_srgb

# A float32 has steps of 8 mm there, which the renderers would show; beyond is a typing error.
MAX_LENGTH_M = 1e5


def read_length(item: SectionReader, key: str) -> float:
    """Length above 0, in metres."""
    return item.get_float(key, min_value=1e-6, max_value=MAX_LENGTH_M)


def read_position(item: SectionReader, key: str, default: Vector | None = None) -> Vector:
    """Point in the world frame, in metres."""
    return item.get_vector(key, default, min_value=-MAX_LENGTH_M, max_value=MAX_LENGTH_M)


def read_colour(settings: SectionReader, key: str, default: tuple[int, int, int]) -> Rgb:
    """Linear RGB of a colour in sRGB bytes, 0 to 255 each."""
    rgb = settings.get_vector(key, default, members="RGB", min_value=0.0, max_value=255.0)
    r, g, b = linear_from_srgb(np.array(rgb) / 255.0)
    return float(r), float(g), float(b)
