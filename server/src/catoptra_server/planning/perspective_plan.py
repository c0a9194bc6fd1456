"""Plan of a perspective camera's frames: the number of samples, with a reason.

A perspective image needs no faces and no mirror, so nothing else is left to decide.
"""

from __future__ import annotations

from catoptra_protocol.errors import DomainError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.planning.explicit_plan import DEFAULT_SAMPLES
from catoptra_server.render.renderer_kind import RendererKind


@dataclass(frozen=True, slots=True)
class PerspectivePlan:
    """Plan of one perspective camera."""

    renderer: RendererKind
    samples: int
    """Samples along a pixel's side; a pixel has samples^2."""
    reason: str
    """Reason of the renderer's choice, for the log."""

    def __post_init__(self) -> None:
        # The same limits as of RenderPlan.
        if not 1 <= self.samples <= 16:
            raise DomainError(f"samples must be 1 to 16 along a pixel's side, not {self.samples}")

    @property
    def has_exact_rays(self) -> bool:
        """Whether each pixel has the ray of the camera model: always."""
        return True

    def __str__(self) -> str:
        return f"{self.renderer.value}, {self.samples}^2 samples: {self.reason}"


def plan_perspective_view(samples: int, *, kind: RendererKind, reason: str) -> PerspectivePlan:
    """Plan a perspective view; 0 samples: as many as an omnidirectional camera's default."""
    return PerspectivePlan(kind, samples or DEFAULT_SAMPLES, reason)
