"""EGL's devices on this machine, and libraries that cannot be loaded."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_server.commands.doctor import egl_devices as module
from catoptra_server.commands.doctor.devices import run_in_subprocess
from helpers.opengl import device_or_skip


def test_devices_when_there_is_opengl_are_listed() -> None:
    device_or_skip().close()
    result = run_in_subprocess("egl-devices")
    assert result.error == ""
    assert result.values["devices"]


def test_library_when_it_cannot_be_loaded_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LIBRARY", "libNoEGL.so.1")
    with pytest.raises(RendererUnavailableError, match=r"libNoEGL\.so\.1 cannot be loaded"):
        module.list_egl_devices()


def test_library_when_broken_is_reported_by_the_child_process(tmp_path: Path) -> None:
    (tmp_path / "libEGL.so.1").touch()
    result = run_in_subprocess("egl-devices", environment={"LD_LIBRARY_PATH": str(tmp_path)})
    assert "libEGL.so.1 cannot be loaded" in result.error


def test_drivers_when_absent_leave_no_device(tmp_path: Path) -> None:
    device_or_skip().close()
    result = run_in_subprocess(
        "egl-devices", environment={"__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path)}
    )
    if not result.error and result.values["devices"]:
        pytest.skip("needs libglvnd: this libEGL is a driver itself")
    assert not result.values.get("devices")
