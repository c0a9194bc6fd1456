"""Names that fit a line of the control protocol."""

from __future__ import annotations

import pytest

from catoptra_server.config.section_reader import is_wire_name


@pytest.mark.parametrize("name", ["P2AT", "R1_left", "naïve", "a|b~c", "x" * 256])
def test_wire_name_when_valid_is_accepted(name: str) -> None:
    assert is_wire_name(name)


@pytest.mark.parametrize("name", ["", "two words", "a{b", "a}b", "a\tb", "€", "x" * 257])
def test_wire_name_when_invalid_is_rejected(name: str) -> None:
    assert not is_wire_name(name)
