"""Texts of errors."""

from __future__ import annotations

from catoptra_protocol.errors import ConfigError, SourceLocation


def test_config_error_of_a_long_value_names_its_beginning_and_length() -> None:
    error = ConfigError(SourceLocation("x.ini", 3), key="K", value=1_000_000 * "a", expected="1")
    assert len(str(error)) < 400
    assert str(error).startswith("x.ini:3: K='aaa")
    assert "1000000 characters" in str(error)


def test_config_error_of_a_short_value_names_it_whole() -> None:
    error = ConfigError(SourceLocation("x.ini", 3), key="K", value="a\n", expected="1")
    assert str(error) == "x.ini:3: K='a\\n': expected 1"
