"""Regions of the cube's faces that the mirror sees, with their texel density.

Data only: `planning/face_regions.py` computes the regions of a camera, raster packs them into an
atlas. Coordinates on a face are (s, t) of `optics/cube_map`, -1 to 1 for its 90 degrees.
"""

from __future__ import annotations

from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class FaceWindow:
    """Rectangle on a face's plane: s from `left` to `right`, t from `top` to `bottom`."""

    left: float = -1.0
    top: float = -1.0
    right: float = 1.0
    bottom: float = 1.0

    @property
    def is_empty(self) -> bool:
        """Whether the window has no area."""
        return self.left >= self.right or self.top >= self.bottom


@dataclass(frozen=True, slots=True)
class FaceRegion:
    """Window of a face, with the texel density in both directions."""

    face: Face
    window: FaceWindow
    columns_per_unit: float
    """Texel columns for one unit of s."""
    rows_per_unit: float
    """Texel rows for one unit of t."""

    @property
    def size_texels(self) -> tuple[float, float]:
        """Width and height in texels, not rounded."""
        window = self.window
        width = (window.right - window.left) * self.columns_per_unit
        return width, (window.bottom - window.top) * self.rows_per_unit

    @property
    def num_texels(self) -> float:
        """Number of texels, not rounded."""
        width, height = self.size_texels
        return width * height
