"""A traced image of a perspective camera: every ray, with or without shadows."""

from __future__ import annotations

from collections.abc import Callable

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.renderer import RenderedImage
from catoptra_server.render.trace.ray_view import RayView


class TraceLensView:
    """A perspective camera's views, one with and one without shadows."""

    def __init__(self, make_view: Callable[[bool], RayView], *, ray_bytes: int) -> None:
        """Build the view without shadows.

        Args:
            make_view: Builds the view with or without shadows, each at its first use.
            ray_bytes: Size of the rays that both views share.
        """
        self._make_view = make_view
        self._ray_bytes = ray_bytes
        # Most camera states have no shadows: prepared now, so that the first frame need not wait.
        self._views = {False: make_view(False)}

    @property
    def memory_bytes(self) -> int:
        """Size of all arrays."""
        return self._ray_bytes + sum(view.memory_bytes for view in self._views.values())

    def render(self, camera_state: CameraState) -> RenderedImage:
        """Render one exposure of the camera."""
        if camera_state.has_shadows not in self._views:
            self._views[camera_state.has_shadows] = self._make_view(camera_state.has_shadows)
        return self._views[camera_state.has_shadows].render(camera_state)

    def close(self) -> None:
        """Do nothing: all resources belong to the renderer."""
