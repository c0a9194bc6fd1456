"""Views of ordinary cameras on demand: a camera that nobody watches is never prepared.

A view depends on size and field of view alone, so robots of one class share it, and a camera that
zooms asks for another one. What was not drawn for longest is closed first.
"""

from __future__ import annotations

from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_server.render.renderer import Exposure, RenderedImage, Renderer, View

# Clients choose fields of view: without a limit each would leave a view behind. A robot has a few
# cameras; a view of 320 x 240 px at 2 x 2 samples holds some 4 MB.
CAPACITY = 16


class PerspectiveViews:
    """The views of one renderer. Belongs to the renderer's thread; close it before the renderer."""

    def __init__(self, renderer: Renderer, samples: int, *, capacity: int = CAPACITY) -> None:
        self._renderer = renderer
        self._samples = samples
        self._capacity = capacity
        self._views: dict[PerspectiveCamera, View] = {}  # the last drawn at the end

    def __len__(self) -> int:
        """Return how many views are prepared."""
        return len(self._views)

    def draw(self, camera: PerspectiveCamera, exposure: Exposure) -> RenderedImage:
        """Return the picture of a camera; it is prepared when it is drawn for the first time."""
        view = self._views.pop(camera, None)
        if view is None:
            self._make_room()
            view = self._renderer.prepare_perspective(camera, self._samples)
        self._views[camera] = view
        return view.draw(exposure)

    def _make_room(self) -> None:
        while len(self._views) >= self._capacity:
            self._views.pop(next(iter(self._views))).close()

    def close(self) -> None:
        """Free all views."""
        for view in self._views.values():
            view.close()
        self._views.clear()
