"""The processes that answer one question each."""

from __future__ import annotations

from catoptra_server.doctor.subprocess_check import run_in_subprocess
from helpers.configs import FIELD, OMNI_ROBOT


def test_question_when_unknown_is_refused() -> None:
    assert run_in_subprocess("weather").error == "no question 'weather'"


def test_question_when_the_library_is_missing_is_answered_with_its_reason() -> None:
    answer = run_in_subprocess("self-test", "paint")
    assert "auto, trace or raster, not 'paint'" in answer.error


def test_configurations_when_asked_for_are_examined() -> None:
    facts = run_in_subprocess("configurations", "1", str(OMNI_ROBOT), str(FIELD)).values
    assert [f["topic"] for f in facts["findings"]] == ["robot p2at_omni", "world four_legged_2006"]
