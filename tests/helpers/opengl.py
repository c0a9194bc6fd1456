"""OpenGL for tests: a device, or else a skip with the reason."""

from __future__ import annotations

import pytest

from catoptra_server.render.raster import OpenGLMissingError, open_device
from catoptra_server.render.raster.device import GlDevice


def device_or_skip() -> GlDevice:
    """Open an OpenGL device; skip the test on a machine without OpenGL."""
    try:
        return open_device()
    except OpenGLMissingError as error:
        pytest.skip(f"needs OpenGL: {error.reason}")
