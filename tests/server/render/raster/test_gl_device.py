from __future__ import annotations

from dataclasses import replace

import pytest

from catoptra_server.render.raster import device as module
from catoptra_server.render.raster.device import GlDevice, OpenGLMissingError, open_device


@pytest.mark.parametrize("library", ["EGL_LIBRARY", "GL_LIBRARY"])
def test_missing_library_is_named_with_the_packages_that_bring_it(
    library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("EGL_LIBRARY", "GL_LIBRARY"):
        monkeypatch.setattr(module, name, "libc.so.6")
    monkeypatch.setattr(module, library, "libabsent.so.1")
    with pytest.raises(OpenGLMissingError, match="libgl1 libegl1 libgl1-mesa-dri") as caught:
        open_device()
    assert caught.value.reason.startswith("libabsent.so.1 cannot be loaded")


def test_context_that_cannot_be_created_is_reported_with_the_reason(
    device: GlDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "REQUIRED_VERSION", 990)
    with pytest.raises(OpenGLMissingError, match="EGL offers no OpenGL"):
        open_device()


@pytest.mark.parametrize(
    ("renderer", "software"),
    [
        ("llvmpipe (LLVM 15.0.6, 256 bits)", True),
        ("softpipe", True),
        ("NVIDIA H200/PCIe/SSE2", False),
        ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", False),
    ],
)
def test_software_is_recognized_by_the_renderer_name(
    device: GlDevice, renderer: str, software: bool
) -> None:
    assert replace(device, renderer=renderer).is_software is software
