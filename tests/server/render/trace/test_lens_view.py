from __future__ import annotations

import numpy as np

from catoptra_server.render.renderer import Image, LinearImage
from catoptra_server.render.trace.lens_view import TraceLensView
from catoptra_server.render.trace.trace_engine import RayHits, TracedExposure
from helpers.worlds import CAMERA_STATE


class OnePixelRays:
    """Rays of one white pixel."""

    memory_bytes = 123

    def __init__(self) -> None:
        self.is_closed = False

    def render_srgb(self, exposure: TracedExposure) -> Image:
        return np.full((1, 1, 3), 255, dtype=np.uint8)

    def render_linear(self, exposure: TracedExposure) -> LinearImage:
        raise AssertionError("a perspective image has no effects")

    def find_hits(self, exposure: TracedExposure) -> RayHits:
        raise AssertionError("a perspective image has no ranges")

    def close(self) -> None:
        self.is_closed = True


def test_view_shows_the_engine_s_image_and_frees_its_rays() -> None:
    rays = OnePixelRays()
    view = TraceLensView(rays)
    rendered = view.render(CAMERA_STATE)
    assert rendered.rgb.tolist() == [[[255, 255, 255]]]
    assert list(rendered.stage_ms) == ["trace"]
    assert view.memory_bytes == 123
    view.close()
    assert rays.is_closed
