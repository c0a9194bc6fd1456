"""The processes that answer one question each."""

from __future__ import annotations

from catoptra_server.doctor.children import ask
from helpers.configs import FIELD, OMNI_ROBOT


def test_question_when_unknown_is_refused() -> None:
    assert ask("weather").trouble == "no question 'weather'"


def test_question_when_the_library_is_missing_is_answered_with_its_reason() -> None:
    answer = ask("self-test", "paint")
    assert "auto, trace or raster, not 'paint'" in answer.trouble


def test_configurations_when_asked_for_are_examined() -> None:
    facts = ask("configurations", "1", str(OMNI_ROBOT), str(FIELD)).facts
    assert [f["topic"] for f in facts["findings"]] == ["robot p2at_omni", "world four_legged_2006"]
