"""What a robot's file asks of its camera's picture: a surface to draw, and numbers for it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from catoptra_protocol.errors import DomainError
from catoptra_server.scene.mirror_mesh import Tessellation


@dataclass(frozen=True, slots=True)
class PerPixel:
    """The mirror's exact law in every sample."""


MirrorSurface = PerPixel | Tessellation


@dataclass(frozen=True, slots=True)
class AccuracyTarget:
    """What is asked of a picture instead of numbers; 0 = not asked.

    max_error_px: how far off any outline may be at most. budget_ms: how long a frame may take. With
    both, the tolerance is kept as cheaply as can be, and where it does not fit into the budget, the
    budget is kept.
    """

    max_error_px: float = 0.0
    budget_ms: float = 0.0

    def __post_init__(self) -> None:
        for name in ("max_error_px", "budget_ms"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise DomainError(f"{name} must be 0 (not asked) or more, not {value}")

    def with_changes(
        self, *, max_error_px: float | None, budget_ms: float | None
    ) -> AccuracyTarget:
        """Return the dial with another tolerance, another budget, or both; None: as it is."""
        return AccuracyTarget(
            self.max_error_px if max_error_px is None else max_error_px,
            self.budget_ms if budget_ms is None else budget_ms,
        )

    @property
    def is_set(self) -> bool:
        """Return whether anything is asked."""
        return self.max_error_px > 0.0 or self.budget_ms > 0.0


@dataclass(frozen=True, slots=True)
class RenderSettings:
    """What the configuration asks of the picture; 0 leaves a number to the plan.

    texels_per_px: of the faces, where no face size is asked for. dial: where it is set, the plan
    chooses all numbers, whatever these are.
    """

    surface: MirrorSurface = PerPixel()
    samples: int = 0
    face_size_px: int = 0
    face_samples: int = 0
    stride_px: int = 0
    texels_per_px: float = 0.0
    accuracy_target: AccuracyTarget = AccuracyTarget()
