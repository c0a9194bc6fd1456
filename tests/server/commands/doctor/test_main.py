"""The child process of a check: its results and its errors."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.commands.doctor.devices import run_in_subprocess
from helpers.configs import FIELD, OMNI_ROBOT


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (("weather",), "no check is named 'weather'"),
        (("self-test", "paint"), "auto, trace or raster, not 'paint'"),
    ],
)
def test_check_when_unknown_prints_the_reason(arguments: tuple[str, ...], reason: str) -> None:
    with pytest.raises(CatoptraError, match=reason):
        run_in_subprocess(*arguments)


def test_configurations_when_named_are_checked() -> None:
    values = run_in_subprocess("configurations", "1", str(OMNI_ROBOT), str(FIELD))
    assert [f["topic"] for f in values["findings"]] == ["robot p2at_omni", "world four_legged_2006"]
