"""Renderers that draw nothing, and costs in proportion to the samples that nobody measured."""

from __future__ import annotations

from typing import Any

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.frames.plan.costs import PlanTiming
from catoptra_server.frames.plan.planner import MeasureCosts, generate_calibration_plans
from catoptra_server.frames.renderers import RendererChoice, RendererPool
from catoptra_server.render.renderer import MirrorSurface
from catoptra_server.render.renderer_kind import RendererKind


class NamedRenderer:
    """A renderer that has a description, and can be closed."""

    def __init__(self, name: str = "trace") -> None:
        self.name, self.closed = name, False

    def describe(self) -> str:
        """The name."""
        return self.name

    def close(self) -> None:
        """Record the closing."""
        self.closed = True


def make_pool(renderer: Any = None, **others: Any) -> RendererPool:
    """Pool of a trace renderer that was chosen for the reason "test"."""
    found = renderer or NamedRenderer()
    return RendererPool(RendererChoice(found, RendererKind.TRACE, "test", **others))


def measure_per_sample(ms: float = 1.0, fixed_ms: float = 0.0) -> MeasureCosts:
    """Measurement of frames that take so long for each sample of a pixel, in one stage."""

    def measure(
        renderer: object, kind: RendererKind, camera: OmniCamera, surface: MirrorSurface, *_: object
    ) -> list[PlanTiming]:
        plans = generate_calibration_plans(kind, camera, surface)
        return [PlanTiming(p, {kind.value: fixed_ms + ms * p.samples**2}) for p in plans]

    return measure
