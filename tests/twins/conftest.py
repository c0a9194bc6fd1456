"""One OpenGL device for all twins of a module."""

from __future__ import annotations

from collections.abc import Iterator

import moderngl
import pytest

from helpers.opengl import device_or_skip


@pytest.fixture(scope="module")
def context() -> Iterator[moderngl.Context]:
    device = device_or_skip()
    with device.context as context:
        yield context
    device.close()
