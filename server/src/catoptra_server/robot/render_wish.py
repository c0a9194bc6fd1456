"""What a robot's file asks of its camera's picture: a surface to draw, and numbers for it."""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_server.scene.mirror_mesh import PolygonSplit


@dataclass(frozen=True, slots=True)
class PerPixel:
    """The mirror's exact law in every sample."""


Surface = PerPixel | PolygonSplit


@dataclass(frozen=True, slots=True)
class RenderWish:
    """What the configuration asks of the picture; 0 leaves a number to the plan."""

    surface: Surface = PerPixel()
    samples: int = 0
    face_size_px: int = 0
    face_samples: int = 0
    stride_px: int = 0
