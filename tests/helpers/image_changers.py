"""Image effects by the native kernel, for raster; tests are skipped where it cannot run."""

from __future__ import annotations

from contextlib import ExitStack

import pytest

from catoptra_server.render.image_changer import ImageChanger
from catoptra_server.render.trace.kernel.image import KernelImageChanger
from catoptra_server.render.trace.kernel.library import KernelUnavailableError


def open_changer_or_skip(stack: ExitStack) -> ImageChanger:
    """Image effects by two threads of the kernel, which end with the stack."""
    try:
        changer = KernelImageChanger.open(2)
    except KernelUnavailableError as error:
        pytest.skip(error.reason)
    stack.callback(changer.close)
    return changer
