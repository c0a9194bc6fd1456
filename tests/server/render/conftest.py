"""One OpenGL device a module (opening takes a third of a second); renderers of either kind."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import Renderer
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.kernel import kernel_engine
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.opengl import device_or_skip, make_raster
from helpers.renderers import RendererFactory


@pytest.fixture(autouse=True)
def _prove_parts_of_small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small pictures show whether proofs hold; users' small pictures have none."""
    monkeypatch.setattr(kernel_engine, "MIN_PROVEN_RAYS", 0)


@pytest.fixture(scope="module")
def device() -> Iterator[GlDevice]:
    device = device_or_skip()
    yield device
    device.close()


@pytest.fixture(params=["trace", "raster"])
def make_renderer(request: pytest.FixtureRequest) -> Iterator[RendererFactory]:
    """Factory of renderers of either kind; trace's threads end with the test."""
    with ExitStack() as stack:

        def make_trace(world: World) -> Renderer:
            renderer = TraceRenderer(build_scene(world), world, threads=2)
            stack.callback(renderer.close)
            return renderer

        def make_rastered(world: World) -> Renderer:
            return make_raster(request.getfixturevalue("device"), world)

        yield make_trace if request.param == "trace" else make_rastered
