"""Prepared views of eyes, on demand: a camera that nobody watches is never prepared.

Robots of one class share a view, and a camera that zooms asks for another one. What was not drawn
for longest is closed first. Belongs to the thread that made the renderer.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

from catoptra_server.imaging.shot import Eye, OmniEye, Take
from catoptra_server.plan.perspective_plan import PerspectivePlan, plan_perspective
from catoptra_server.plan.render_plan import RendererKind, RenderPlan, plan_from_wish
from catoptra_server.render.renderer import RenderedImage, Renderer, View

log = logging.getLogger(__name__)

# Clients choose fields of view: without a limit each would leave a view behind. A robot has a few
# cameras; a view of 320 x 240 px at 2 x 2 samples holds some 4 MB.
CAPACITY = 16

Plan = RenderPlan | PerspectivePlan


@dataclass(frozen=True, slots=True, eq=False)
class _Prepared:
    """A view and the plan that it follows."""

    plan: Plan
    view: View


class Views:
    """The views of one renderer; closing them frees the renderer, too."""

    def __init__(
        self, renderer: Renderer, kind: RendererKind, why: str, *, capacity: int = CAPACITY
    ) -> None:
        self._renderer = renderer
        self._kind = kind
        self._why = why
        self._capacity = capacity
        self._prepared: dict[Eye, _Prepared] = {}  # the last drawn at the end

    def __len__(self) -> int:
        """Return how many views are prepared."""
        return len(self._prepared)

    def draw(self, take: Take) -> RenderedImage:
        """Return the picture of a take; its eye is prepared when it is drawn for the first time."""
        return self._used(take.eye).view.draw(take.exposure)

    def plan(self, eye: Eye) -> Plan:
        """Return how an eye is drawn."""
        return self._used(eye).plan

    def _used(self, eye: Eye) -> _Prepared:
        prepared = self._prepared.pop(eye, None) or self._prepare(eye)
        self._prepared[eye] = prepared
        return prepared

    def _prepare(self, eye: Eye) -> _Prepared:
        while len(self._prepared) >= self._capacity:
            self._prepared.pop(next(iter(self._prepared))).view.close()
        match eye:
            case OmniEye(camera, wish):
                plan = plan_from_wish(wish, camera, kind=self._kind, why=self._why)
                log.info("plan of %d x %d px: %s", camera.width_px, camera.height_px, plan)
                return _Prepared(plan, self._renderer.prepare(camera, plan))
            case _:
                flat = plan_perspective(0, kind=self._kind, why=self._why)
                return _Prepared(flat, self._renderer.prepare_perspective(eye, flat.samples))

    def close(self) -> None:
        """Free all views, and the renderer."""
        for prepared in self._prepared.values():
            prepared.view.close()
        self._prepared.clear()
        self._renderer.close()
