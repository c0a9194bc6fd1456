from __future__ import annotations

import dataclasses

import numpy as np

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.renderer import Image, RenderedImage
from catoptra_server.render.trace.lens_view import TraceLensView
from helpers.worlds import CAMERA_STATE


class ShadowFlagView:
    """A view whose only pixel shows whether it was built with shadows."""

    def __init__(self, has_shadows: bool) -> None:
        self._image: Image = np.full((1, 1, 3), has_shadows, dtype=np.uint8)

    def render(self, camera_state: CameraState) -> RenderedImage:
        return RenderedImage(self._image, {})


def test_view_when_shadows_vary_builds_each_source_once() -> None:
    builds: list[bool] = []

    def make_view(has_shadows: bool) -> ShadowFlagView:
        builds.append(has_shadows)
        return ShadowFlagView(has_shadows)

    view = TraceLensView(make_view, ray_bytes=0)  # type: ignore[arg-type]
    shadowed = dataclasses.replace(CAMERA_STATE, has_shadows=True)
    greys = [
        int(view.render(camera_state).rgb[0, 0, 0])
        for camera_state in (CAMERA_STATE, shadowed, CAMERA_STATE, shadowed)
    ]
    assert greys == [0, 1, 0, 1]
    assert builds == [False, True]
    view.close()
