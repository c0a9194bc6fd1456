"""Findings: one line each with its remedy, and the exit status of several."""

from __future__ import annotations

import pytest

from catoptra_server.commands.doctor.machine import (
    Finding,
    exit_status,
    fault,
    finding_from_dict,
    ok,
    warning,
)

FACT = ok("python", "3.11")
WARNING = warning("opengl", "none", remedy="install it")
FAULT = fault("ports", "taken", remedy="take another")


@pytest.mark.parametrize(
    ("found", "status"),
    [((), 0), ((FACT,), 0), ((FACT, WARNING), 1), ((WARNING, FAULT, FACT), 2)],
    ids=["nothing", "facts", "warning", "fault"],
)
def test_status_when_findings_are_summed_is_the_worst(
    found: tuple[Finding, ...], status: int
) -> None:
    assert exit_status(found) == status


def test_problem_when_printed_is_one_line_with_its_remedy() -> None:
    assert str(FAULT) == "fault    ports: taken. Remedy: take another"
    assert str(FACT) == "ok       python: 3.11"


def test_finding_when_sent_as_a_dictionary_comes_back() -> None:
    assert finding_from_dict(WARNING.as_dict()) == WARNING
