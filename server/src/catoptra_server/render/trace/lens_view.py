"""A traced image of a perspective camera, encoded directly."""

from __future__ import annotations

import time

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.renderer import RenderedImage
from catoptra_server.render.trace.trace_engine import TracedRays


class TraceLensView:
    """The rays of a perspective camera."""

    def __init__(self, rays: TracedRays) -> None:
        """Keep the prepared rays."""
        self._rays = rays

    @property
    def memory_bytes(self) -> int:
        """Size of all arrays."""
        return self._rays.memory_bytes

    def render(self, camera_state: CameraState) -> RenderedImage:
        """Render one exposure of the camera."""
        begin = time.perf_counter()
        rgb = self._rays.render_srgb(camera_state)
        return RenderedImage(rgb, {"trace": 1e3 * (time.perf_counter() - begin)})

    def close(self) -> None:
        """Free the rays."""
        self._rays.close()
