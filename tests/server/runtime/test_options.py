"""Options: limits are included, everything else is rejected in one line of plain words."""

from __future__ import annotations

from argparse import ArgumentTypeError
from collections.abc import Callable

import pytest

from catoptra_server.runtime.options import (
    CommandParser,
    int_within,
    parse_float_within,
    parse_integer,
    parse_non_negative,
    parse_port,
    parse_threads,
    parse_tiles,
)


@pytest.mark.parametrize(
    ("parse", "text", "value"),
    [
        (parse_port, "0", 0),
        (parse_port, "65535", 65535),
        (parse_threads, "1024", 1024),
        (parse_integer, "-7", -7),
        (parse_non_negative, "0", 0.0),
        (parse_non_negative, "1e3", 1000.0),
        (parse_tiles, "2x1:320x240", (2, 1, 320, 240)),
        (int_within("a skip", 1, 3), "3", 3),
    ],
)
def test_value_within_its_limits_is_read(
    parse: Callable[[str], object], text: str, value: object
) -> None:
    assert parse(text) == value


@pytest.mark.parametrize(
    ("parse", "text", "message"),
    [
        (parse_port, "65536", "a port is 0 to 65535, not 65536"),
        (parse_port, "http", "a port is an integer from 0 to 65535, not 'http'"),
        (parse_integer, "1.5", "a seed is an integer, not '1.5'"),
        (parse_non_negative, "nan", "a tolerance or a budget is 0 or more, not 'nan'"),
        (parse_non_negative, "inf", "a tolerance or a budget is 0 or more, not 'inf'"),
        (parse_non_negative, "-1", "a tolerance or a budget is 0 or more, not '-1'"),
        (parse_tiles, "2x2", "a multi-view has the form 2x2:320x240, not '2x2'"),
    ],
)
def test_value_when_wrong_is_rejected_with_the_expected_form(
    parse: Callable[[str], object], text: str, message: str
) -> None:
    with pytest.raises(ArgumentTypeError) as caught:
        parse(text)
    assert str(caught.value) == message


def test_float_beyond_its_limit_is_rejected_with_its_unit() -> None:
    assert parse_float_within("60", name="a time", last=60.0, unit="s") == 60.0
    with pytest.raises(ArgumentTypeError, match=r"^a time is 0 to 60 s, not '61'$"):
        parse_float_within("61", name="a time", last=60.0, unit="s")


def test_error_is_one_line_and_a_pointer_to_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        CommandParser(prog="program").parse_args(["--bogus"])
    assert ended.value.code == 2
    assert capsys.readouterr().err == (
        "program: unrecognized arguments: --bogus\n`program --help` lists the options\n"
    )
