"""Faults in the log: one traceback each, then a line."""

from __future__ import annotations

import logging

import pytest

from catoptra_server.runtime.faults import log_fault

log = logging.getLogger("fault")


def fail(number: int) -> None:
    try:
        raise ZeroDivisionError(number)
    except ZeroDivisionError:
        log_fault(log, "robot %d failed", number)


def test_fault_has_its_traceback_once(caplog: pytest.LogCaptureFixture) -> None:
    for number in range(3):
        fail(number)
    assert [bool(record.exc_info) for record in caplog.records] == [True, False, False]
    messages = [record.getMessage() for record in caplog.records]
    assert messages[2] == "robot 2 failed: ZeroDivisionError(2)"


def test_fault_of_another_origin_has_a_traceback_of_its_own(
    caplog: pytest.LogCaptureFixture,
) -> None:
    for make in (lambda: [][0], lambda: [][1]):  # two origins, on one line each
        try:
            make()
        except IndexError:
            log_fault(log, "no element")
    fail(4)
    assert sum(bool(record.exc_info) for record in caplog.records) >= 1
