"""The plan of an ordinary camera's picture: how many samples, and why.

A flat picture needs no faces and no mirror, so nothing else is left to decide.
"""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_protocol.errors import DomainError
from catoptra_server.planning.explicit_plan import DEFAULT_SAMPLES
from catoptra_server.render.renderer_kind import RendererKind


@dataclass(frozen=True, slots=True)
class PerspectivePlan:
    """samples: the picture has samples^2 per pixel. reason: in words, for the log."""

    renderer: RendererKind
    samples: int
    reason: str

    def __post_init__(self) -> None:
        if not 1 <= self.samples <= 16:
            raise DomainError(f"samples must be 1 to 16 along a pixel's side, not {self.samples}")

    def __str__(self) -> str:
        return f"{self.renderer.value}, {self.samples}^2 samples: {self.reason}"


def plan_perspective_view(samples: int, *, kind: RendererKind, reason: str) -> PerspectivePlan:
    """Return the plan from a wished number of samples, 0 = as the omni camera has by default."""
    return PerspectivePlan(kind, samples or DEFAULT_SAMPLES, reason)
