"""OpenGL for tests: a device, or else a skip with the reason; renderers on a device."""

from __future__ import annotations

import pytest

from catoptra_server.render.image_changer import ImageChanger
from catoptra_server.render.raster import OpenGLMissingError, RasterRenderer, open_device
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.worlds import make_test_world


def device_or_skip() -> GlDevice:
    """Open an OpenGL device; skip the test on a machine without OpenGL."""
    try:
        return open_device()
    except OpenGLMissingError as error:
        pytest.skip(f"needs OpenGL: {error.reason}")


def make_raster(
    device: GlDevice, world: World | None = None, changer: ImageChanger | None = None
) -> RasterRenderer:
    """Raster renderer of a world on a device that outlives the renderer; None: the test world."""
    world = make_test_world() if world is None else world
    return RasterRenderer(build_scene(world), world, device=device, image_changer=changer)
