"""Renderers and devices of this machine, each tried in a process of its own.

A driver may crash, hang or print to stdout; a library may fail to load: a process of its own keeps
the doctor running. Its result is the last line on stdout, a JSON object; `__main__` is the
child's side. Trace and, on each EGL device, raster draw a self-test. Missing OpenGL is a warning
where `auto` falls back to trace, and a fault with `--renderer raster`.

EGL's list of devices comes through its C interface, before any context is created; the query loads
the drivers' libraries. Sources: EGL_EXT_device_enumeration, EGL_EXT_device_query,
EGL_MESA_device_software, EGL_EXT_device_drm.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from catoptra_protocol.errors import CatoptraError, RendererUnavailableError
from catoptra_server.commands.doctor.machine import Finding, fault, ok, warning

# The slowest check, a self-test on two busy processors, takes some seconds.
_TIMEOUT_S = 60.0
_OPENGL_PACKAGES = "libgl1 libegl1 libgl1-mesa-dri"
# Folders in which libglvnd, the dispatching libEGL, searches for drivers.
_VENDOR_FOLDERS = (Path("/etc/glvnd/egl_vendor.d"), Path("/usr/share/glvnd/egl_vendor.d"))
_VENDOR_VARIABLES = ("__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS")
_INSTALL_REMEDY = f"install {_OPENGL_PACKAGES} (Debian, Ubuntu); or start with --renderer trace"
_REINSTALL_REMEDY = "pip install --force-reinstall catoptra-server"
_EGL_LIBRARY = "libEGL.so.1"
# EGL_EXTENSIONS and EGL_DRM_DEVICE_FILE_EXT of egl.h and eglext.h.
_EXTENSIONS = 0x3055
_DRM_DEVICE_FILE = 0x3233
# Far above the number of GPUs in one machine.
_MAX_DEVICES = 32
_FUNCTION_NAMES = (b"eglQueryDevicesEXT", b"eglQueryDeviceStringEXT")
_QUERY_DEVICES = ctypes.CFUNCTYPE(
    ctypes.c_uint, ctypes.c_int, ctypes.POINTER(ctypes.c_void_p), ctypes.POINTER(ctypes.c_int)
)
_QUERY_STRING = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.c_void_p, ctypes.c_int)


_RunCheck = Callable[..., dict[str, Any]]
_MakeFinding = Callable[..., Finding]


def run_in_subprocess(
    *arguments: str, environment: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Run `python -m catoptra_server.commands.doctor` with these arguments; the printed object.

    Args:
        arguments: name of the check, and its arguments.
        environment: variables in addition to this process's.

    Raises:
        CatoptraError: There is no result; the reason as a clause of a message.
    """
    try:
        process = subprocess.run(
            [sys.executable, "-m", "catoptra_server.commands.doctor", *arguments],
            env={**os.environ, **(environment or {})},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            # Drivers print in encodings of their own.
            errors="replace",
            timeout=_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise CatoptraError(f"no result within {_TIMEOUT_S:g} s") from None
    # A negative status is the signal that ended the process, SIGSEGV for most broken drivers.
    if process.returncode < 0:
        raise CatoptraError(f"crashed ({_signal_name(-process.returncode)})")
    # The last line of a traceback names the exception; `__main__` prints the reason alone.
    if process.returncode > 0:
        raise CatoptraError(_last_line(process.stderr) or f"exit status {process.returncode}")
    line = _last_line(process.stdout)
    try:
        values = json.loads(line)
    except ValueError:
        values = None
    if not isinstance(values, dict):
        raise CatoptraError(f"the output is no JSON object: {line[:80]!r}")
    return values


def check_renderers(renderer: str, run_check: _RunCheck = run_in_subprocess) -> Iterator[Finding]:
    """Yield the results of the self-tests.

    Args:
        renderer: `auto`, `trace` or `raster`, as for the server; only the renderers that the server
            may choose are checked.
        run_check: runs a check in a process of its own.
    """
    if renderer != "raster":
        run_self_test = partial(run_check, "self-test", "trace")
        yield _try_self_test(run_self_test, "trace", "trace", fault, _REINSTALL_REMEDY)
    if renderer != "trace":
        yield from _check_opengl(run_check, fault if renderer == "raster" else warning)


def _check_opengl(run_check: _RunCheck, make_finding: _MakeFinding) -> Iterator[Finding]:
    """Yield the devices of EGL, and the self-test of each. The server uses the first device."""
    try:
        devices = run_check("egl-devices")["devices"]
        if not devices:
            raise CatoptraError(f"{_EGL_LIBRARY} lists no device")
    except CatoptraError as error:
        message = f"raster cannot run: {error}; {_describe_drivers()}"
        yield make_finding("opengl", message, remedy=_INSTALL_REMEDY)
        return
    yield ok("opengl", f"EGL devices: {', '.join(devices)}; {_describe_drivers()}")
    for number, device in enumerate(devices):
        # glcontext, below moderngl, reads the variable. The server leaves the variable unset, which
        # is device 0: problems of the other devices are warnings.
        environment = {"GLCONTEXT_DEVICE_INDEX": f"{number}"}
        run_self_test = partial(run_check, "self-test", "raster", environment=environment)
        topic = f"raster on device {number} ({device})"
        make = make_finding if number == 0 else warning
        remedy = f"update the driver, or {_INSTALL_REMEDY}"
        yield _try_self_test(run_self_test, "raster", topic, make, remedy)


def _describe_drivers() -> str:
    """Drivers that libEGL finds, by an environment variable or in the vendor folders."""
    for variable in _VENDOR_VARIABLES:
        # A variable set for another program is a frequent cause of `no device`.
        if variable in os.environ:
            return f"drivers are those of {variable}={os.environ[variable]}"
    names = [path.stem for folder in _VENDOR_FOLDERS for path in sorted(folder.glob("*.json"))]
    return f"drivers: {', '.join(names) or 'none'}"


def _try_self_test(
    run_self_test: Callable[[], dict[str, Any]],
    renderer: str,
    topic: str,
    make_finding: _MakeFinding,
    remedy: str,
) -> Finding:
    """Finding of a self-test: an error, a displacement beyond the bound, or the measurement."""
    try:
        values = run_self_test()
    except CatoptraError as error:
        message = f"the {renderer} renderer cannot run: {error}"
        return make_finding(topic, message, remedy=remedy)
    error_px, bound_px = values["error_px"], values["bound_px"]
    # The topic names the renderer already.
    description = values["renderer"].removeprefix(f"{renderer}: ")
    measured = f"a disc is displaced by {error_px:.3f} px from the camera model"
    # Negated, so that the infinite error of a dark frame and NaN fail too.
    if not error_px <= bound_px:
        message = f"{description} renders wrongly: {measured}, the bound is {bound_px:.3f} px"
        return make_finding(topic, message, remedy=f"{remedy}; and report this as a bug")
    measured += f" (bound {bound_px:.3f}) in {values['duration_s']:.2f} s"
    return ok(topic, f"{description}: {measured}")


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1].strip() if lines else ""


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # real-time signals have no names
        return f"signal {number}"


def list_egl_devices() -> list[str]:
    """Description of each device, in EGL's order, as counted by GLCONTEXT_DEVICE_INDEX.

    Raises:
        RendererUnavailableError: without libEGL, or without a driver that lists devices.
    """
    egl = _Egl()
    devices, count = (ctypes.c_void_p * _MAX_DEVICES)(), ctypes.c_int()
    if not egl.query_devices(_MAX_DEVICES, devices, ctypes.byref(count)):
        return []
    return [_describe_device(egl, device) for device in devices[: count.value] if device]


def _describe_device(egl: _Egl, device: int) -> str:
    # Null is returned for an unknown name: a device need not have either string.
    extensions = (egl.query_string(device, _EXTENSIONS) or b"").decode().split()
    if "EGL_MESA_device_software" in extensions:
        return "software"
    if "EGL_EXT_device_drm" in extensions:
        return (egl.query_string(device, _DRM_DEVICE_FILE) or b"a device without a file").decode()
    return "a device of its driver's own"


class _Egl:
    """The two extension functions of libEGL that the query needs."""

    def __init__(self) -> None:
        try:
            library = ctypes.CDLL(_EGL_LIBRARY)
        except OSError as error:
            raise RendererUnavailableError(f"{_EGL_LIBRARY} cannot be loaded ({error})") from error
        # Extension functions are not exported symbols; without restype ctypes would cut the address
        # to 32 bits.
        library.eglGetProcAddress.restype = ctypes.c_void_p
        addresses = [library.eglGetProcAddress(name) for name in _FUNCTION_NAMES]
        if not all(addresses):  # libglvnd without any driver has not even these
            raise RendererUnavailableError(f"{_EGL_LIBRARY} has no driver that lists devices")
        self.query_devices = _QUERY_DEVICES(addresses[0])
        self.query_string = _QUERY_STRING(addresses[1])
