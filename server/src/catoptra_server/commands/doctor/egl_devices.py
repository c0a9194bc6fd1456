"""EGL's list of devices, through its C interface, before any context is created.

The query loads the drivers' libraries, which may crash: run in a process of its own. Sources:
EGL_EXT_device_enumeration, EGL_EXT_device_query, EGL_MESA_device_software, EGL_EXT_device_drm.
"""

from __future__ import annotations

import ctypes

from catoptra_protocol.errors import RendererUnavailableError

LIBRARY = "libEGL.so.1"
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


class _Egl:
    """The two extension functions of libEGL that the query needs."""

    def __init__(self) -> None:
        try:
            library = ctypes.CDLL(LIBRARY)
        except OSError as error:
            raise RendererUnavailableError(f"{LIBRARY} cannot be loaded ({error})") from error
        # Extension functions are not exported symbols; without restype ctypes would cut the address
        # to 32 bits.
        library.eglGetProcAddress.restype = ctypes.c_void_p
        addresses = [library.eglGetProcAddress(name) for name in _FUNCTION_NAMES]
        if not all(addresses):  # libglvnd without any driver lacks even these
            raise RendererUnavailableError(f"{LIBRARY} has no driver that lists devices")
        self.query_devices = _QUERY_DEVICES(addresses[0])
        self.query_string = _QUERY_STRING(addresses[1])


def list_egl_devices() -> list[str]:
    """Description of each device, in EGL's order, which is that of GLCONTEXT_DEVICE_INDEX.

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
