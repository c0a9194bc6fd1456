"""The child process of a check: its results and its errors."""

from __future__ import annotations

from catoptra_server.commands.doctor.devices import run_in_subprocess
from helpers.configs import FIELD, OMNI_ROBOT


def test_check_when_unknown_is_rejected() -> None:
    assert run_in_subprocess("weather").error == "no check is named 'weather'"


def test_check_when_a_renderer_is_unknown_prints_the_reason() -> None:
    result = run_in_subprocess("self-test", "paint")
    assert "auto, trace or raster, not 'paint'" in result.error


def test_configurations_when_named_are_checked() -> None:
    values = run_in_subprocess("configurations", "1", str(OMNI_ROBOT), str(FIELD)).values
    assert [f["topic"] for f in values["findings"]] == ["robot p2at_omni", "world four_legged_2006"]
