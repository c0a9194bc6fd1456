"""Errors of a command line: one line and a pointer to the help."""

from __future__ import annotations

import pytest

from catoptra_server.runtime.options import EXIT_USAGE, CommandParser


def test_error_is_one_line_and_a_pointer_to_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        CommandParser(prog="program").parse_args(["--bogus"])
    assert ended.value.code == EXIT_USAGE
    assert capsys.readouterr().err == (
        "program: unrecognized arguments: --bogus\n`program --help` lists the options\n"
    )
