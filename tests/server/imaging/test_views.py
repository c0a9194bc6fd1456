"""What nobody watches is not prepared, what is watched again is not prepared again."""

from __future__ import annotations

from typing import Any

import numpy as np

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_server.imaging.shot import OmniEye, Take
from catoptra_server.imaging.views import Views
from catoptra_server.plan.render_plan import RendererKind, RenderPlan
from catoptra_server.render.renderer import Exposure, RenderedImage
from helpers.robots import CAMERA

HERE = Exposure(Pose.identity())


class CountingRenderer:
    """Prepares views that draw black and write down what happens."""

    def __init__(self) -> None:
        self.log: list[str] = []

    def prepare_perspective(self, camera: PerspectiveCamera, samples: int) -> Any:
        self.log.append(f"prepare {camera.width_px}")
        return CountingView(self.log, camera)

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> Any:
        self.log.append(f"prepare omni {camera.width_px}")
        return CountingView(self.log, camera)

    def close(self) -> None:
        self.log.append("close renderer")


class CountingView:
    def __init__(self, log: list[str], camera: PerspectiveCamera | OmniCamera) -> None:
        self._log, self._camera = log, camera

    def draw(self, exposure: Exposure) -> RenderedImage:
        shape = (self._camera.height_px, self._camera.width_px, 3)
        return RenderedImage(np.zeros(shape, dtype=np.uint8), {})

    def close(self) -> None:
        self._log.append(f"close {self._camera.width_px}")


def views_of(renderer: Any, *, capacity: int = 16) -> Views:
    return Views(renderer, RendererKind.TRACE, "test", capacity=capacity)


def draw(views: Views, *widths: int) -> None:
    for width in widths:
        views.draw(Take(PerspectiveCamera(width, 10, 1.0), HERE))


def test_nothing_is_prepared_before_it_is_drawn() -> None:
    renderer = CountingRenderer()
    assert len(views_of(renderer)) == 0
    assert renderer.log == []


def test_equal_cameras_share_a_view() -> None:
    renderer = CountingRenderer()
    draw(views_of(renderer), 20, 20, 30, 20)
    assert renderer.log == ["prepare 20", "prepare 30"]


def test_view_drawn_longest_ago_makes_room() -> None:
    renderer = CountingRenderer()
    views = views_of(renderer, capacity=2)
    draw(views, 20, 30, 20, 40)
    assert renderer.log[-2:] == ["close 30", "prepare 40"]
    assert len(views) == 2


def test_close_frees_all() -> None:
    renderer = CountingRenderer()
    views = views_of(renderer)
    draw(views, 20, 30)
    views.close()
    assert renderer.log[-3:] == ["close 20", "close 30", "close renderer"]
    assert len(views) == 0


def test_omnidirectional_eye_is_drawn_by_the_plan_that_is_told() -> None:
    renderer = CountingRenderer()
    views, eye = views_of(renderer), OmniEye(CAMERA.camera, CAMERA.wish)
    assert "test" in str(views.plan(eye))
    views.draw(Take(eye, HERE))
    assert renderer.log == ["prepare omni 8"]
