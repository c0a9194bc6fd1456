"""Processes that answer, and those that crash, hang or chatter instead."""

from __future__ import annotations

import sys

import pytest

from catoptra_server.doctor.subprocess_check import CheckResult, run_command


def run_code(code: str, *, timeout_s: float = 30.0) -> CheckResult:
    """Return the answer of a piece of Python."""
    return run_command([sys.executable, "-c", code], timeout_s=timeout_s)


def test_answer_when_a_driver_chatters_before_is_the_last_line() -> None:
    assert run_code("print('libEGL warning: x'); print('{\"a\": 1}')") == CheckResult({"a": 1})


@pytest.mark.parametrize(
    ("code", "trouble"),
    [
        ("import os; os.abort()", "it crashed (SIGABRT)"),
        ("import os; os.kill(os.getpid(), 11)", "it crashed (SIGSEGV)"),
        ("import sys; sys.exit('no library')", "no library"),
        ("import sys; sys.exit(3)", "it ended with 3"),
        ("print('hello')", "it said nothing that can be read: 'hello'"),
        ("print('[1]')", "it said nothing that can be read: '[1]'"),
        ("", "it said nothing that can be read: ''"),
    ],
)
def test_trouble_when_a_process_fails_is_told(code: str, trouble: str) -> None:
    assert run_code(code) == CheckResult(error=trouble)


def test_process_when_it_hangs_is_ended() -> None:
    hanging = run_code("import threading; threading.Event().wait()", timeout_s=0.5)
    assert hanging.error == "it did not end within 0.5 s"
