"""A traced picture of a camera with a lens: every ray, with shadows where an exposure has them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from catoptra_server.render.renderer import Exposure, RenderedImage
from catoptra_server.render.trace.ray_view import RayView


class TraceLensView:
    """A camera's views; source: makes one with or without shadows when it is first asked for."""

    def __init__(self, source: Callable[[bool], RayView]) -> None:
        self._source = cache(source)
        self._source(False)  # most have none, and nobody wants to wait for them

    def draw(self, exposure: Exposure) -> RenderedImage:
        """Return the picture of an exposure."""
        return self._source(exposure.has_shadows).draw(exposure)

    def close(self) -> None:
        """Nothing is held that the renderer does not hold."""
