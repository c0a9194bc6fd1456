"""Prepared views, bounded by the memory that they hold.

Cameras share a view if camera model and plan are equal: targets between two candidate plans, and
robots of one class. Belongs to the thread of the renderers.
"""

from __future__ import annotations

import logging

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.frames.frame_plan import ViewKey
from catoptra_server.planning.perspective_plan import PerspectivePlan
from catoptra_server.planning.renderer_pool import RendererPool
from catoptra_server.render.renderer import View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.faults import log_fault
from catoptra_server.runtime.memory import release_freed_memory

log = logging.getLogger(__name__)

# Clients choose tolerances and fields of view, and each choice may need a view of its own: 25
# tolerances took 0.9 GB. Enough for 30 views of 360 x 360 px at 2 x 2 samples.
MAX_VIEW_BYTES = 256 * 2**20
# A view of few pixels still holds tables of the scene's edges, and framebuffers on the device.
MAX_VIEWS = 64
# Seven views of 193 MB in all left 62 MB of gaps between them. Closing the gaps takes 0.4 to 9 ms,
# beside 30 ms or more for the rays of so many bytes.
_RELEASE_BYTES = 4 * 2**20


@dataclass(slots=True, eq=False)
class _StoredView:
    view: View
    memory_bytes: int


class ViewStore:
    """The prepared views of one scene."""

    def __init__(
        self,
        renderers: RendererPool,
        *,
        max_bytes: int = MAX_VIEW_BYTES,
        max_views: int = MAX_VIEWS,
    ) -> None:
        """Create an empty store.

        Args:
            renderers: Renderers that prepare the views.
            max_bytes: Memory above which the view used longest ago is closed; one view is kept
                whatever its size.
            max_views: Number of views above which the view used longest ago is closed.
        """
        self._renderers = renderers
        self._max_bytes = max_bytes
        self._max_views = max_views
        self._views: dict[ViewKey, _StoredView] = {}  # the last used at the end
        self._newest: tuple[ViewKey, _StoredView] | None = None
        self._changed_bytes = 0

    def __len__(self) -> int:
        """Number of prepared views."""
        return len(self._views)

    @property
    def memory_bytes(self) -> int:
        """Memory of all views, each as of its last use; of a single view as of its preparation."""
        return sum(stored.memory_bytes for stored in self._views.values())

    def get(self, key: ViewKey) -> View:
        """View of a camera by its plan, prepared at the first use."""
        # By identity first: hashing camera and plan takes longer than all else here.
        if self._newest is not None and self._newest[0] is key:
            return self._newest[1].view
        if len(self._views) == 1:
            self._measure_newest()  # `trim` has not, as long as there was no other
        # Removed and inserted again: dicts keep the order of insertion.
        stored = self._views.pop(key, None) or self._prepare(key)
        self._views[key] = stored
        self._newest = key, stored
        return stored.view

    def _prepare(self, key: ViewKey) -> _StoredView:
        camera, plan = key
        renderer = self._renderers.get(plan.renderer)
        view: View
        if isinstance(plan, PerspectivePlan):
            assert isinstance(camera, PerspectiveCamera), "a lens has a perspective plan"
            view = renderer.prepare_perspective(camera, plan.samples)
        else:
            assert isinstance(camera, OmniCamera), "a mirror has a render plan"
            view = renderer.prepare(camera, plan)
        stored = _StoredView(view, view.memory_bytes)
        self._changed_bytes += stored.memory_bytes
        return stored

    def trim(self) -> None:
        """Close the views used longest ago, down to the limits; to be called after each use."""
        # A single view stays whatever its size; to have its memory counted by the renderer's
        # library takes a quarter of the time that a frame takes here beside the drawing.
        if len(self._views) > 1:
            self._measure_newest()
        while len(self._views) > 1 and (
            len(self._views) > self._max_views or self.memory_bytes > self._max_bytes
        ):
            self._close(next(iter(self._views)))
        if self._changed_bytes >= _RELEASE_BYTES:
            release_freed_memory()
            self._changed_bytes = 0

    def _measure_newest(self) -> None:
        """Record the memory of the view used last, to which effects and shadows may have added."""
        newest = next(reversed(self._views.values()))
        newest.memory_bytes = newest.view.memory_bytes

    def close_views_of(self, kind: RendererKind) -> None:
        """Close all views of one renderer."""
        for key in [key for key in self._views if key[1].renderer is kind]:
            self._close(key)

    def close(self) -> None:
        """Close all views."""
        for key in list(self._views):
            self._close(key)

    def _close(self, key: ViewKey) -> None:
        self._newest = None
        stored = self._views.pop(key)
        self._changed_bytes += stored.memory_bytes
        try:
            stored.view.close()
        except Exception:
            # Of a renderer that failed: it is closed as a whole.
            log_fault(log, "a view could not be closed")
