"""OpenGL for tests: a device where there is one, else a skip that says why."""

from __future__ import annotations

import pytest

from catoptra_server.render.raster import OpenGLMissingError, open_device
from catoptra_server.render.raster.gl_device import GlDevice


def device_or_skip() -> GlDevice:
    """Return an OpenGL device of one's own; skip the test on a machine that has none."""
    try:
        return open_device()
    except OpenGLMissingError as error:
        pytest.skip(f"needs OpenGL: {error.reason}")
