"""Which renderers run here, on which devices, and how exact they are: a self-test each.

Every device is tried in a process of its own. Where there is no OpenGL that is a warning, not a
fault: the server traces then, unless raster is asked for.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from catoptra_server.doctor.children import Answer, ask
from catoptra_server.doctor.egl_devices import LIBRARY
from catoptra_server.doctor.finding import Finding, fault, ok, warning

PACKAGES = "libgl1 libegl1 libgl1-mesa-dri"
# Where libglvnd, the libEGL that shares a machine among drivers, looks for them.
VENDOR_FOLDERS = (Path("/etc/glvnd/egl_vendor.d"), Path("/usr/share/glvnd/egl_vendor.d"))
_VENDOR_VARIABLES = ("__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS")
_INSTALL = f"on Debian and Ubuntu install {PACKAGES}; or draw by trace, which needs none of them"

Ask = Callable[..., Answer]
Complaint = Callable[[str, str, str], Finding]


def renderer_findings(renderer: str, ask: Ask = ask) -> Iterator[Finding]:
    """Yield how trace and raster do, as far as `auto`, `trace` or `raster` may take them."""
    if renderer != "raster":
        yield _self_test("trace", "trace", ask(*("self-test", "trace")), _fatal, _REINSTALL)
    if renderer != "trace":
        yield from _opengl(ask, _fatal if renderer == "raster" else _bearable)


_REINSTALL = "pip install --force-reinstall embreex, whose wheels are for x86-64 only"


def _fatal(topic: str, what: str, remedy: str) -> Finding:
    return fault(topic, what, remedy=remedy)


def _bearable(topic: str, what: str, remedy: str) -> Finding:
    return warning(topic, what, remedy=remedy)


def _opengl(ask: Ask, complain: Complaint) -> Iterator[Finding]:
    """Yield what EGL offers, and how each device draws. The first is the one that serves."""
    listed = ask("egl-devices")
    if listed.trouble:
        what = f"raster cannot run: {listed.trouble}; {_drivers()}"
        yield complain("opengl", what, _INSTALL)
        return
    devices = listed.facts["devices"]
    if not devices:
        what = f"raster cannot run: {LIBRARY} lists no device; {_drivers()}"
        yield complain("opengl", what, _INSTALL)
        return
    yield ok("opengl", f"EGL devices: {', '.join(devices)}; {_drivers()}")
    for number, device in enumerate(devices):
        answer = ask("self-test", "raster", environment={"GLCONTEXT_DEVICE_INDEX": f"{number}"})
        topic = f"raster on device {number} ({device})"
        remedy = f"update the driver, or {_INSTALL}"
        yield _self_test("raster", topic, answer, complain if number == 0 else _bearable, remedy)


def _drivers() -> str:
    """Return the drivers that libEGL would find, or that it is told to look elsewhere."""
    for variable in _VENDOR_VARIABLES:
        if variable in os.environ:
            return f"drivers are those of {variable}={os.environ[variable]}"
    names = [path.stem for folder in VENDOR_FOLDERS for path in sorted(folder.glob("*.json"))]
    return f"drivers: {', '.join(names) or 'none'}"


def _self_test(
    renderer: str, topic: str, answer: Answer, complain: Complaint, remedy: str
) -> Finding:
    """Return how the self-test of a renderer went."""
    if answer.trouble:
        return complain(topic, f"the {renderer} renderer cannot run: {answer.trouble}", remedy)
    error_px, bound_px = answer.facts["error_px"], answer.facts["bound_px"]
    measured = f"a disc is {error_px:.3f} px from where the camera law puts it"
    if not error_px <= bound_px:
        what = f"{answer.facts['renderer']} draws wrongly: {measured}, at most {bound_px:.3f} px"
        return complain(topic, what, f"{remedy}; and report this as a bug")
    said = f"{answer.facts['renderer']}: {measured} (bound {bound_px:.3f}), "
    return ok(topic, f"{said}drawn in {answer.facts['took_s']:.2f} s")
