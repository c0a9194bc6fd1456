from __future__ import annotations

import dataclasses

import numpy as np

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.renderer import Image, RenderedImage
from catoptra_server.render.trace.lens_view import TraceLensView
from helpers.worlds import CAMERA_STATE


class Drawn:
    """A view that shows whether it has shadows."""

    def __init__(self, has_shadows: bool) -> None:
        self._image: Image = np.full((1, 1, 3), has_shadows, dtype=np.uint8)

    def draw(self, exposure: CameraState) -> RenderedImage:
        return RenderedImage(self._image, {})


def test_view_when_exposures_have_shadows_makes_that_source_once() -> None:
    made: list[bool] = []

    def source(has_shadows: bool) -> Drawn:
        made.append(has_shadows)
        return Drawn(has_shadows)

    view = TraceLensView(source)  # type: ignore[arg-type]
    shadowed = dataclasses.replace(CAMERA_STATE, has_shadows=True)
    greys = [
        int(view.render(exposure).rgb[0, 0, 0])
        for exposure in (CAMERA_STATE, shadowed, CAMERA_STATE, shadowed)
    ]
    assert greys == [0, 1, 0, 1]
    assert made == [False, True]
    view.close()
