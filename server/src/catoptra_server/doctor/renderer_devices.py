"""Which renderers run here, on which devices, and how exact they are: a self-test each.

Every device is tried in a process of its own. Where there is no OpenGL that is a warning, not a
fault: the server traces then, unless raster is asked for.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from catoptra_server.doctor.egl_devices import LIBRARY
from catoptra_server.doctor.finding import Finding, fault, ok, warning
from catoptra_server.doctor.subprocess_check import CheckResult, run_in_subprocess

OPENGL_PACKAGES = "libgl1 libegl1 libgl1-mesa-dri"
# Where libglvnd, the libEGL that shares a machine among drivers, looks for them.
VENDOR_FOLDERS = (Path("/etc/glvnd/egl_vendor.d"), Path("/usr/share/glvnd/egl_vendor.d"))
_VENDOR_VARIABLES = ("__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS")
_INSTALL_REMEDY = (
    f"on Debian and Ubuntu install {OPENGL_PACKAGES}; or draw by trace, which needs none of them"
)

RunCheck = Callable[..., CheckResult]
MakeFinding = Callable[[str, str, str], Finding]


def check_renderers(renderer: str, run_check: RunCheck = run_in_subprocess) -> Iterator[Finding]:
    """Yield how trace and raster do, as far as `auto`, `trace` or `raster` may take them."""
    if renderer != "raster":
        yield _make_self_test_finding(
            "trace", "trace", run_check(*("self-test", "trace")), _make_fault, _REINSTALL_REMEDY
        )
    if renderer != "trace":
        yield from _check_opengl(run_check, _make_fault if renderer == "raster" else _make_warning)


_REINSTALL_REMEDY = "pip install --force-reinstall embreex, whose wheels are for x86-64 only"


def _make_fault(topic: str, message: str, remedy: str) -> Finding:
    return fault(topic, message, remedy=remedy)


def _make_warning(topic: str, message: str, remedy: str) -> Finding:
    return warning(topic, message, remedy=remedy)


def _check_opengl(run_check: RunCheck, make_finding: MakeFinding) -> Iterator[Finding]:
    """Yield what EGL offers, and how each device draws. The first is the one that serves."""
    listed = run_check("egl-devices")
    if listed.error:
        what = f"raster cannot run: {listed.error}; {_describe_drivers()}"
        yield make_finding("opengl", what, _INSTALL_REMEDY)
        return
    devices = listed.values["devices"]
    if not devices:
        what = f"raster cannot run: {LIBRARY} lists no device; {_describe_drivers()}"
        yield make_finding("opengl", what, _INSTALL_REMEDY)
        return
    yield ok("opengl", f"EGL devices: {', '.join(devices)}; {_describe_drivers()}")
    for number, device in enumerate(devices):
        answer = run_check(
            "self-test", "raster", environment={"GLCONTEXT_DEVICE_INDEX": f"{number}"}
        )
        topic = f"raster on device {number} ({device})"
        remedy = f"update the driver, or {_INSTALL_REMEDY}"
        yield _make_self_test_finding(
            "raster", topic, answer, make_finding if number == 0 else _make_warning, remedy
        )


def _describe_drivers() -> str:
    """Return the drivers that libEGL would find, or that it is told to look elsewhere."""
    for variable in _VENDOR_VARIABLES:
        if variable in os.environ:
            return f"drivers are those of {variable}={os.environ[variable]}"
    names = [path.stem for folder in VENDOR_FOLDERS for path in sorted(folder.glob("*.json"))]
    return f"drivers: {', '.join(names) or 'none'}"


def _make_self_test_finding(
    renderer: str, topic: str, result: CheckResult, make_finding: MakeFinding, remedy: str
) -> Finding:
    """Return how the self-test of a renderer went."""
    if result.error:
        return make_finding(topic, f"the {renderer} renderer cannot run: {result.error}", remedy)
    error_px, bound_px = result.values["error_px"], result.values["bound_px"]
    measured = f"a disc is {error_px:.3f} px from where the camera law puts it"
    if not error_px <= bound_px:
        what = f"{result.values['renderer']} draws wrongly: {measured}, at most {bound_px:.3f} px"
        return make_finding(topic, what, f"{remedy}; and report this as a bug")
    said = f"{result.values['renderer']}: {measured} (bound {bound_px:.3f}), "
    return ok(topic, f"{said}drawn in {result.values['took_s']:.2f} s")
