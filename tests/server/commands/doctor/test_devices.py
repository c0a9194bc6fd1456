"""Checks in child processes that crash, hang or print; findings on renderers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_server.commands.doctor import devices as devices_module
from catoptra_server.commands.doctor.devices import (
    CheckResult,
    check_renderers,
    list_egl_devices,
    run_command,
    run_in_subprocess,
)
from catoptra_server.commands.doctor.machine import Finding, Level, exit_status
from helpers.opengl import device_or_skip


def run_code(code: str, *, timeout_s: float = 30.0) -> CheckResult:
    """Result of a process that runs a piece of Python."""
    return run_command([sys.executable, "-c", code], timeout_s=timeout_s)


def test_result_when_a_driver_prints_before_is_the_last_line() -> None:
    assert run_code("print('libEGL warning: x'); print('{\"a\": 1}')") == CheckResult({"a": 1})


@pytest.mark.parametrize(
    ("code", "error"),
    [
        ("import os; os.abort()", "crashed (SIGABRT)"),
        ("import os; os.kill(os.getpid(), 11)", "crashed (SIGSEGV)"),
        ("import sys; sys.exit('no library')", "no library"),
        ("import sys; sys.exit(3)", "exit status 3"),
        ("print('hello')", "the output is no JSON object: 'hello'"),
        ("print('[1]')", "the output is no JSON object: '[1]'"),
        ("", "the output is no JSON object: ''"),
    ],
)
def test_error_when_a_process_fails_has_the_reason(code: str, error: str) -> None:
    assert run_code(code) == CheckResult(error=error)


def test_process_when_it_hangs_is_stopped_at_the_timeout() -> None:
    hanging = run_code("import threading; threading.Event().wait()", timeout_s=0.5)
    assert hanging.error == "no result within 0.5 s"


GOOD_RESULT = CheckResult(
    {"renderer": "a renderer", "error_px": 0.05, "bound_px": 0.2, "duration_s": 1.0}
)
WRONG_RESULT = CheckResult(
    {"renderer": "a renderer", "error_px": 2.5, "bound_px": 0.2, "duration_s": 1.0}
)
DARK_RESULT = CheckResult(
    {"renderer": "a renderer", "error_px": float("inf"), "bound_px": 0.2, "duration_s": 1.0}
)
CRASHED_RESULT = CheckResult(error="crashed (SIGSEGV)")


def fake_run_check(
    *,
    devices: CheckResult,
    trace: CheckResult = GOOD_RESULT,
    raster: tuple[CheckResult, ...] = (GOOD_RESULT,),
) -> Callable[..., CheckResult]:
    """A `run_in_subprocess` with these results; raster's by the number of the device."""

    def run_check(*arguments: str, environment: Mapping[str, str] | None = None) -> CheckResult:
        match arguments:
            case ("egl-devices",):
                return devices
            case ("self-test", "trace"):
                return trace
        assert arguments == ("self-test", "raster")
        return raster[int((environment or {})["GLCONTEXT_DEVICE_INDEX"])]

    return run_check


ONE = CheckResult({"devices": ["software"]})
TWO = CheckResult({"devices": ["/dev/dri/card0", "software"]})


def problems(renderer: str, run_check: Callable[..., CheckResult]) -> list[Finding]:
    """Findings that are problems."""
    return [f for f in check_renderers(renderer, run_check) if f.level is not Level.OK]


@pytest.mark.parametrize("renderer", ["auto", "trace", "raster"])
def test_renderers_when_all_run_have_no_problem(renderer: str) -> None:
    assert problems(renderer, fake_run_check(devices=ONE)) == []


@pytest.mark.parametrize(
    ("devices", "reason"),
    [
        (CheckResult(error="libEGL.so.1 cannot be loaded"), "libEGL.so.1 cannot be loaded"),
        (CheckResult(error="crashed (SIGSEGV)"), "crashed (SIGSEGV)"),
        (CheckResult({"devices": []}), "lists no device"),
    ],
    ids=["no libEGL", "crash", "no driver"],
)
@pytest.mark.parametrize(("renderer", "status"), [("auto", 1), ("raster", 2), ("trace", 0)])
def test_opengl_when_missing_is_a_fault_only_for_raster(
    devices: CheckResult, reason: str, renderer: str, status: int
) -> None:
    found = problems(renderer, fake_run_check(devices=devices))
    assert exit_status(found) == status
    assert all(reason in f.message and "libegl1" in f.remedy for f in found)


@pytest.mark.parametrize(
    "result", [CRASHED_RESULT, WRONG_RESULT, DARK_RESULT], ids=["crash", "wrong", "dark"]
)
def test_device_when_it_fails_alone_is_the_only_problem(result: CheckResult) -> None:
    found = problems("raster", fake_run_check(devices=TWO, raster=(GOOD_RESULT, result)))
    assert [(f.level, f.topic) for f in found] == [(Level.WARNING, "raster on device 1 (software)")]


@pytest.mark.parametrize(
    "result", [CRASHED_RESULT, WRONG_RESULT, DARK_RESULT], ids=["crash", "wrong", "dark"]
)
def test_device_when_the_first_fails_is_a_fault_for_raster_alone(
    result: CheckResult,
) -> None:
    run_check = fake_run_check(devices=ONE, raster=(result,))
    assert exit_status(problems("raster", run_check)) == 2
    assert exit_status(problems("auto", run_check)) == 1


def test_trace_when_it_cannot_run_is_a_fault() -> None:
    (found,) = problems(
        "auto", fake_run_check(devices=ONE, trace=CheckResult(error="No module 'embreex'"))
    )
    assert found.level is Level.FAULT
    assert "embreex" in found.remedy


@pytest.mark.parametrize(("renderer", "status"), [("auto", 1), ("trace", 2), ("raster", 0)])
def test_trace_without_embreex_is_a_fault_only_where_it_is_requested(
    monkeypatch: pytest.MonkeyPatch, renderer: str, status: int
) -> None:
    monkeypatch.setattr(devices_module, "has_embreex", lambda: False)
    trace = CheckResult(error="needs the package embreex")
    run_check = fake_run_check(devices=ONE, trace=trace, raster=(GOOD_RESULT,))
    assert exit_status(problems(renderer, run_check)) == status


def test_neither_renderer_is_a_fault_for_auto(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices_module, "has_embreex", lambda: False)
    run_check = fake_run_check(devices=CheckResult(error="x"), trace=CheckResult(error="y"))
    assert exit_status(problems("auto", run_check)) == 2


@pytest.mark.parametrize("renderer", ["trace", "raster"])
def test_self_test_when_the_description_names_the_renderer_shows_the_name_once(
    renderer: str,
) -> None:
    named = CheckResult({**GOOD_RESULT.values, "renderer": f"{renderer}: 2 threads, 9 triangles"})
    run_check = fake_run_check(devices=ONE, trace=named, raster=(named,))
    *_, finding = check_renderers(renderer, run_check)
    assert str(finding).count(f"{renderer}: ") <= 1
    assert ": 2 threads, 9 triangles: a disc" in str(finding)


def test_devices_when_there_is_opengl_are_listed() -> None:
    device_or_skip().close()
    result = run_in_subprocess("egl-devices")
    assert result.error == ""
    assert result.values["devices"]


def test_library_when_it_cannot_be_loaded_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices_module, "_EGL_LIBRARY", "libNoEGL.so.1")
    with pytest.raises(RendererUnavailableError, match=r"libNoEGL\.so\.1 cannot be loaded"):
        list_egl_devices()


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
