"""Checks in child processes that crash, hang or print; findings on renderers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.errors import CatoptraError, RendererUnavailableError
from catoptra_server.commands.doctor import devices as devices_module
from catoptra_server.commands.doctor.devices import (
    check_renderers,
    list_egl_devices,
    run_in_subprocess,
)
from catoptra_server.commands.doctor.machine import Finding, Level, exit_status
from helpers.opengl import device_or_skip


@pytest.fixture
def run_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], dict[str, Any]]:
    """Run a check whose process is a piece of Python."""

    def run(code: str) -> dict[str, Any]:
        program = tmp_path / "check"
        program.write_text(f"#!{sys.executable}\n{code}\n")
        program.chmod(0o700)
        monkeypatch.setattr(sys, "executable", str(program))
        return run_in_subprocess("any")

    return run


def test_result_when_a_driver_prints_before_is_the_last_line(
    run_code: Callable[[str], dict[str, Any]],
) -> None:
    assert run_code("print('libEGL warning: x'); print('{\"a\": 1}')") == {"a": 1}


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
        ("import threading; threading.Event().wait()", "no result within 1 s"),
    ],
)
def test_error_when_a_process_fails_has_the_reason(
    run_code: Callable[[str], dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch,
    code: str,
    error: str,
) -> None:
    if "no result" in error:
        monkeypatch.setattr(devices_module, "_TIMEOUT_S", 1.0)
    with pytest.raises(CatoptraError) as caught:
        run_code(code)
    assert str(caught.value) == error


Outcome = dict[str, Any] | str  # a result, or the reason of an error
GOOD = {"renderer": "a renderer", "error_px": 0.05, "bound_px": 0.2, "duration_s": 1.0}
CRASHED = "crashed (SIGSEGV)"
FAILURES = {
    "crash": CRASHED,
    "wrong": {**GOOD, "error_px": 2.5},
    "dark": {**GOOD, "error_px": float("inf")},
}


def fake_run_check(
    *, devices: Outcome, trace: Outcome = GOOD, raster: tuple[Outcome, ...] = (GOOD,)
) -> Callable[..., dict[str, Any]]:
    """A `run_in_subprocess` with these outcomes; raster's by the number of the device."""

    def find_outcome(*arguments: str, environment: Mapping[str, str]) -> Outcome:
        match arguments:
            case ("egl-devices",):
                return devices
            case ("self-test", "trace"):
                return trace
        assert arguments == ("self-test", "raster")
        return raster[int(environment["GLCONTEXT_DEVICE_INDEX"])]

    def run_check(*arguments: str, environment: Mapping[str, str] | None = None) -> dict[str, Any]:
        outcome = find_outcome(*arguments, environment=environment or {})
        if isinstance(outcome, str):
            raise CatoptraError(outcome)
        return outcome

    return run_check


ONE = {"devices": ["software"]}
TWO = {"devices": ["/dev/dri/card0", "software"]}


def problems(renderer: str, run_check: Callable[..., dict[str, Any]]) -> list[Finding]:
    """Findings that are problems."""
    return [f for f in check_renderers(renderer, run_check) if f.level is not Level.OK]


@pytest.mark.parametrize("renderer", ["auto", "trace", "raster"])
def test_renderers_when_all_run_have_no_problem(renderer: str) -> None:
    assert problems(renderer, fake_run_check(devices=ONE)) == []


@pytest.mark.parametrize(
    ("devices", "reason"),
    [
        ("libEGL.so.1 cannot be loaded", "libEGL.so.1 cannot be loaded"),
        (CRASHED, CRASHED),
        ({"devices": []}, "lists no device"),
    ],
    ids=["no libEGL", "crash", "no driver"],
)
@pytest.mark.parametrize(("renderer", "status"), [("auto", 0), ("raster", 1), ("trace", 0)])
def test_opengl_when_missing_is_a_fault_only_for_raster(
    devices: Outcome, reason: str, renderer: str, status: int
) -> None:
    found = problems(renderer, fake_run_check(devices=devices))
    assert exit_status(found) == status
    assert all(reason in f.message and "libegl1" in f.remedy for f in found)


@pytest.mark.parametrize("result", FAILURES.values(), ids=FAILURES)
def test_device_when_it_fails_alone_is_the_only_problem(result: Outcome) -> None:
    found = problems("raster", fake_run_check(devices=TWO, raster=(GOOD, result)))
    assert [(f.level, f.topic) for f in found] == [(Level.WARNING, "raster on device 1 (software)")]


@pytest.mark.parametrize("result", FAILURES.values(), ids=FAILURES)
def test_device_when_the_first_fails_is_a_fault_for_raster_alone(result: Outcome) -> None:
    run_check = fake_run_check(devices=ONE, raster=(result,))
    assert exit_status(problems("raster", run_check)) == 1
    assert exit_status(problems("auto", run_check)) == 0


@pytest.mark.parametrize(("renderer", "status"), [("auto", 1), ("trace", 1), ("raster", 0)])
def test_trace_when_it_cannot_run_is_a_fault_unless_raster_is_requested(
    renderer: str, status: int
) -> None:
    run_check = fake_run_check(devices=ONE, trace="it crashed", raster=(GOOD,))
    assert exit_status(problems(renderer, run_check)) == status


@pytest.mark.parametrize("renderer", ["trace", "raster"])
def test_self_test_when_the_description_names_the_renderer_shows_the_name_once(
    renderer: str,
) -> None:
    named = {**GOOD, "renderer": f"{renderer}: 2 threads, 9 triangles"}
    run_check = fake_run_check(devices=ONE, trace=named, raster=(named,))
    *_, finding = check_renderers(renderer, run_check)
    assert str(finding).count(f"{renderer}: ") <= 1
    assert ": 2 threads, 9 triangles: a disc" in str(finding)


def test_devices_when_there_is_opengl_are_listed() -> None:
    device_or_skip().close()
    assert run_in_subprocess("egl-devices")["devices"]


def test_library_when_it_cannot_be_loaded_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(devices_module, "_EGL_LIBRARY", "libNoEGL.so.1")
    with pytest.raises(RendererUnavailableError, match=r"libNoEGL\.so\.1 cannot be loaded"):
        list_egl_devices()


def test_library_when_broken_is_reported_by_the_child_process(tmp_path: Path) -> None:
    (tmp_path / "libEGL.so.1").touch()
    with pytest.raises(CatoptraError, match=r"libEGL\.so\.1 cannot be loaded"):
        run_in_subprocess("egl-devices", environment={"LD_LIBRARY_PATH": str(tmp_path)})


def test_drivers_when_absent_leave_no_device(tmp_path: Path) -> None:
    device_or_skip().close()
    variables = {"__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path)}
    try:
        devices = run_in_subprocess("egl-devices", environment=variables)["devices"]
    except CatoptraError:
        devices = []
    if devices:
        pytest.skip("needs libglvnd: this libEGL is a driver itself")
    assert not devices
