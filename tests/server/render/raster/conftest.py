"""One OpenGL device a module: opening one takes a third of a second."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from catoptra_server.render.raster.context import GlDevice
from helpers.opengl import device_or_skip


@pytest.fixture(scope="module")
def device() -> Iterator[GlDevice]:
    device = device_or_skip()
    yield device
    device.close()
