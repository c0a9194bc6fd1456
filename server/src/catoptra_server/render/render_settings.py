"""Render settings of a robot's camera, as the robot file requests them.

Data only: `frames/plan` makes a plan, either of these numbers or for the accuracy target.
"""

from __future__ import annotations

import math

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.mirror_mesh import Tessellation


@dataclass(frozen=True, slots=True)
class PerPixel:
    """Exact camera model in every sample, without a mirror mesh."""


MirrorSurface = PerPixel | Tessellation


def has_mesh_viewpoint(camera: OmniCamera) -> bool:
    """Whether a camera has a mirror with one viewpoint, for which a mesh can stand."""
    return camera.has_mirror and camera.mirror.is_central


def require_mesh_viewpoint(camera: OmniCamera) -> None:
    """Raise DomainError for a camera that no mirror mesh can stand for, of a file or a variant.

    Whether rays are approximated as central does not count: the mirror's surface is not the one
    whose mesh would be drawn.
    """
    if has_mesh_viewpoint(camera):
        return
    if not camera.has_mirror:
        raise DomainError("0 polygons: a mesh stands for a mirror, which this camera has not")
    raise DomainError(
        "0 polygons: a mesh looks up directions at one viewpoint, which this mirror has not"
    )


@dataclass(frozen=True, slots=True)
class AccuracyTarget:
    """Tolerance and time budget that a plan has to meet, in place of explicit settings.

    With both, the plan is the fastest within the tolerance; where no plan fits the budget, the
    most accurate within the budget.
    """

    max_error_px: float = 0.0
    """Largest displacement of any outline; 0 for no tolerance."""
    budget_ms: float = 0.0
    """Longest time of a frame; 0 for no budget."""

    def __post_init__(self) -> None:
        for name in ("max_error_px", "budget_ms"):
            value = getattr(self, name)
            # Clients set both by SET and by the stream: NaN would compare false with every cost.
            if not (math.isfinite(value) and value >= 0.0):
                raise DomainError(f"{name} must be 0 (no target) or more, not {value}")

    def with_changes(
        self, *, max_error_px: float | None, budget_ms: float | None
    ) -> AccuracyTarget:
        """Target with other values; None leaves a value unchanged.

        Raises:
            DomainError: A value is negative or not finite.
        """
        return AccuracyTarget(
            self.max_error_px if max_error_px is None else max_error_px,
            self.budget_ms if budget_ms is None else budget_ms,
        )

    @property
    def is_set(self) -> bool:
        """Whether a tolerance or a budget is set."""
        return self.max_error_px > 0.0 or self.budget_ms > 0.0


@dataclass(frozen=True, slots=True)
class RenderSettings:
    """Requested numbers of a plan; 0 leaves a number to the planner."""

    # 0 throughout for a number left to the planner: the ini file's form of an absent key.
    surface: MirrorSurface = PerPixel()
    samples: int = 0
    """Samples along a pixel's side; a pixel has samples^2 rays."""
    face_size_px: int = 0
    """Side of each face of the cube map around the viewpoint."""
    face_samples: int = 0
    """Samples along a texel's side of a face."""
    texels_per_px: float = 0.0
    """Density of the faces in their densest pixel, where no face size is set."""
    renderer: str = ""
    """`trace` or `raster`; empty for the server's choice."""
    central_error_px: float = 0.0
    """Error up to which rays of a mirror without a viewpoint are taken to meet in one, in frames
    without anything nearer; 0 for exact rays in all frames."""
    accuracy_target: AccuracyTarget = AccuracyTarget()
    """Where set, the planner chooses all numbers, whatever is requested above."""
