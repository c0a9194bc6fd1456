"""Checks in a process of their own, so that a crash there does not end the doctor.

A driver may crash, hang or print to stdout; a library may fail to load. The result is the last line
on stdout, a JSON object. `doctor/__main__` is the child's side.

Check of renderers: a self-test of trace, and one of raster on each EGL device.

Each runs in a process of its own. Missing OpenGL is a warning where `auto` falls back to trace, and
a fault with `--renderer raster`.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.commands.doctor.egl_devices import LIBRARY
from catoptra_server.commands.doctor.machine import Finding, fault, ok, warning
from catoptra_server.render.renderer_kind import EMBREEX_PACKAGE, has_embreex

# The slowest check, a self-test on two busy processors, takes some seconds.
_TIMEOUT_S = 60.0


@dataclass(frozen=True, slots=True)
class CheckResult:
    """Outcome of a check."""

    values: dict[str, Any] = field(default_factory=dict)
    """The printed object; empty after an error."""
    error: str = ""
    """Reason for the lack of a result, as a clause of a message; empty if there is a result."""


def run_in_subprocess(*arguments: str, environment: Mapping[str, str] | None = None) -> CheckResult:
    """Run `python -m catoptra_server.commands.doctor` with these arguments.

    Args:
        arguments: name of the check, and its own arguments.
        environment: variables in addition to those of this process.
    """
    command = [sys.executable, "-m", "catoptra_server.commands.doctor", *arguments]
    return run_command(command, environment={**os.environ, **(environment or {})})


def run_command(
    command: Sequence[str],
    *,
    environment: Mapping[str, str] | None = None,
    timeout_s: float = _TIMEOUT_S,
) -> CheckResult:
    """Run a command that prints its result; a failure of any kind becomes CheckResult.error."""
    try:
        process = subprocess.run(
            command,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            # Drivers print in encodings of their own.
            errors="replace",
            timeout=timeout_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return CheckResult(error=f"no result within {timeout_s:g} s")
    # A negative status is the signal that ended the process, SIGSEGV for most broken drivers.
    if process.returncode < 0:
        return CheckResult(error=f"crashed ({_signal_name(-process.returncode)})")
    # The last line of a traceback names the exception; `main` prints the reason alone.
    if process.returncode > 0:
        return CheckResult(error=_last_line(process.stderr) or f"exit status {process.returncode}")
    return _parse_result(_last_line(process.stdout))


def _parse_result(line: str) -> CheckResult:
    try:
        values = json.loads(line)
    except ValueError:
        values = None
    if not isinstance(values, dict):
        return CheckResult(error=f"the output is no JSON object: {line[:80]!r}")
    return CheckResult(values)


def _last_line(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[-1].strip() if lines else ""


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # real-time signals have no names
        return f"signal {number}"


_OPENGL_PACKAGES = "libgl1 libegl1 libgl1-mesa-dri"
# Folders in which libglvnd, the dispatching libEGL, searches for drivers.
_VENDOR_FOLDERS = (Path("/etc/glvnd/egl_vendor.d"), Path("/usr/share/glvnd/egl_vendor.d"))
_VENDOR_VARIABLES = ("__EGL_VENDOR_LIBRARY_FILENAMES", "__EGL_VENDOR_LIBRARY_DIRS")
_INSTALL_REMEDY = f"install {_OPENGL_PACKAGES} (Debian, Ubuntu); or start with --renderer trace"

_RunCheck = Callable[..., CheckResult]
_MakeFinding = Callable[[str, str, str], Finding]


def check_renderers(renderer: str, run_check: _RunCheck = run_in_subprocess) -> Iterator[Finding]:
    """Yield the results of the self-tests.

    Args:
        renderer: `auto`, `trace` or `raster`, as for the server; only the renderers that the server
            may choose are checked.
        run_check: runs a check in a process of its own.
    """
    if renderer != "raster":
        # Without the package `auto` takes raster.
        make_finding = _make_fault if renderer == "trace" or has_embreex() else _make_warning
        yield _make_self_test_finding(
            "trace", "trace", run_check(*("self-test", "trace")), make_finding, _REINSTALL_REMEDY
        )
    if renderer != "trace":
        # Without the package of trace raster is the only renderer.
        is_only = renderer == "raster" or not has_embreex()
        yield from _check_opengl(run_check, _make_fault if is_only else _make_warning)


_REINSTALL_REMEDY = (
    f"pip install --force-reinstall {EMBREEX_PACKAGE} (wheels exist for x86-64 and for macOS)"
)


def _make_fault(topic: str, message: str, remedy: str) -> Finding:
    return fault(topic, message, remedy=remedy)


def _make_warning(topic: str, message: str, remedy: str) -> Finding:
    return warning(topic, message, remedy=remedy)


def _check_opengl(run_check: _RunCheck, make_finding: _MakeFinding) -> Iterator[Finding]:
    """Yield the devices of EGL, and the self-test of each. The server uses the first device."""
    listed = run_check("egl-devices")
    if listed.error:
        message = f"raster cannot run: {listed.error}; {_describe_drivers()}"
        yield make_finding("opengl", message, _INSTALL_REMEDY)
        return
    devices = listed.values["devices"]
    if not devices:
        message = f"raster cannot run: {LIBRARY} lists no device; {_describe_drivers()}"
        yield make_finding("opengl", message, _INSTALL_REMEDY)
        return
    yield ok("opengl", f"EGL devices: {', '.join(devices)}; {_describe_drivers()}")
    for number, device in enumerate(devices):
        # glcontext, below moderngl, reads the variable. The server leaves it unset, which is device
        # 0: problems of the other devices are warnings.
        result = run_check(
            "self-test", "raster", environment={"GLCONTEXT_DEVICE_INDEX": f"{number}"}
        )
        topic = f"raster on device {number} ({device})"
        remedy = f"update the driver, or {_INSTALL_REMEDY}"
        yield _make_self_test_finding(
            "raster", topic, result, make_finding if number == 0 else _make_warning, remedy
        )


def _describe_drivers() -> str:
    """Drivers that libEGL finds, by an environment variable or in the vendor folders."""
    for variable in _VENDOR_VARIABLES:
        # A variable set for another program is a frequent cause of `no device`.
        if variable in os.environ:
            return f"drivers are those of {variable}={os.environ[variable]}"
    names = [path.stem for folder in _VENDOR_FOLDERS for path in sorted(folder.glob("*.json"))]
    return f"drivers: {', '.join(names) or 'none'}"


def _make_self_test_finding(
    renderer: str, topic: str, result: CheckResult, make_finding: _MakeFinding, remedy: str
) -> Finding:
    """Finding of a self-test: its error, a displacement beyond the bound, or the measurement."""
    if result.error:
        return make_finding(topic, f"the {renderer} renderer cannot run: {result.error}", remedy)
    error_px, bound_px = result.values["error_px"], result.values["bound_px"]
    # The topic names the renderer already.
    description = result.values["renderer"].removeprefix(f"{renderer}: ")
    measured = f"a disc is displaced by {error_px:.3f} px from the camera model"
    # Negated, so that the infinite error of a dark frame and NaN fail too.
    if not error_px <= bound_px:
        message = f"{description} renders wrongly: {measured}, the bound is {bound_px:.3f} px"
        return make_finding(topic, message, f"{remedy}; and report this as a bug")
    duration_s = result.values["duration_s"]
    return ok(topic, f"{description}: {measured} (bound {bound_px:.3f}) in {duration_s:.2f} s")
