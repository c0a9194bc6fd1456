"""Child processes with a result, and others that crash, hang or print instead."""

from __future__ import annotations

import sys

import pytest

from catoptra_server.commands.doctor.devices import CheckResult, run_command


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
