"""Lines of the log: no text of a client can break or forge one."""

from __future__ import annotations

import logging
import sys

import pytest

from catoptra_server.runtime.logs import LogFormatter, escape_controls


def make_record(message: str, *args: object) -> logging.LogRecord:
    return logging.LogRecord("robot", logging.INFO, "", 0, message, args, None)


@pytest.mark.parametrize(
    ("text", "escaped"),
    [
        ("Robot-1 \u00e9\u4e16", "Robot-1 \u00e9\u4e16"),
        ("\x1b[2J", r"\x1b[2J"),
        ("\x00\t\r\x7f\x9b", r"\x00\x09\x0d\x7f\x9b"),
        ("\u2028\u202e\u2066\u200f", r"\u2028\u202e\u2066\u200f"),
    ],
)
def test_control_characters_are_escaped(text: str, escaped: str) -> None:
    assert escape_controls(text) == escaped


def test_line_states_level_logger_and_message() -> None:
    line = LogFormatter().format(make_record("robot %s is in the world", "R\x1b"))
    assert line.endswith(r" INFO    robot: robot R\x1b is in the world")


def test_line_break_in_a_name_begins_no_line_of_its_own() -> None:
    line = LogFormatter().format(make_record("robot %s", "R\n2026-01-01 INFO forged"))
    assert line.split("\n")[1] == "    2026-01-01 INFO forged"


def test_traceback_is_indented_and_escaped() -> None:
    record = make_record("failed")
    try:
        raise ValueError("\x1b]0;title")
    except ValueError:
        record.exc_info = sys.exc_info()
    first, *rest = LogFormatter().format(record).split("\n")
    assert first.endswith("robot: failed")
    assert rest[0] == "    Traceback (most recent call last):"
    assert rest[-1] == r"    ValueError: \x1b]0;title"
