"""A traced image of a perspective camera: every ray, with or without shadows."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.renderer import RenderedImage
from catoptra_server.render.trace.ray_view import RayView


class TraceLensView:
    """A perspective camera's views, one with and one without shadows."""

    def __init__(self, make_view: Callable[[bool], RayView]) -> None:
        """Build the view without shadows; `make_view` builds either one at its first use."""
        self._view = cache(make_view)
        # Most camera states have no shadows: prepared now, so that the first frame need not wait.
        self._view(False)

    def render(self, camera_state: CameraState) -> RenderedImage:
        """Render one exposure of the camera."""
        return self._view(camera_state.has_shadows).render(camera_state)

    def close(self) -> None:
        """Do nothing: all resources belong to the renderer."""
