"""A traced picture of a camera with a lens: every ray, with shadows where an exposure has them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.renderer import RenderedImage
from catoptra_server.render.trace.ray_view import RayView


class TraceLensView:
    """A camera's views; source: makes one with or without shadows when it is first asked for."""

    def __init__(self, make_view: Callable[[bool], RayView]) -> None:
        self._view = cache(make_view)
        self._view(False)  # most have none, and nobody wants to wait for them

    def render(self, camera_state: CameraState) -> RenderedImage:
        """Return the picture of an exposure."""
        return self._view(camera_state.has_shadows).render(camera_state)

    def close(self) -> None:
        """Nothing is held that the renderer does not hold."""
