"""Command lines: values within limits, mistakes in one line of plain words, and the ends."""

from __future__ import annotations

import argparse
import subprocess
import sys
from argparse import ArgumentTypeError
from collections.abc import Callable, Sequence
from functools import partial

import pytest

from catoptra_protocol.command_line import (
    CommandParser,
    int_within,
    parse_count,
    parse_float_within,
    parse_integer,
    parse_port,
    run_program,
)
from catoptra_protocol.errors import CatoptraError

parse_budget = partial(parse_float_within, name="a budget")


@pytest.mark.parametrize(
    ("parse", "text", "value"),
    [
        (parse_port, "0", 0),
        (parse_port, "65535", 65535),
        (parse_integer, "-7", -7),
        (parse_count, "1", 1),
        (parse_budget, "0", 0.0),
        (parse_budget, "1e3", 1000.0),
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
        (parse_count, "0", "a number is 1 to 1000000, not 0"),
        (parse_budget, "nan", "a budget is 0 or more, not 'nan'"),
        (parse_budget, "inf", "a budget is 0 or more, not 'inf'"),
        (parse_budget, "-1", "a budget is 0 or more, not '-1'"),
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


def make_parser() -> CommandParser:
    parser = CommandParser("catoptra-client walk", "Walk.")
    parser.add_argument("--steps", type=parse_count, default=3, metavar="N", help="100 %% of them")
    parser.add_argument("--pose", help="where (default: here)")
    parser.add_argument("--gait", choices=["trot", "gallop"], default="trot", help="gait")
    parser.add_argument("--loud", action=argparse.BooleanOptionalAction, default=True, help="sound")
    parser.add_argument("horse", nargs="?")
    parser.read_too("--steps", "--paces")
    return parser


def read_error(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """The line of a rejected command line."""
    with pytest.raises(SystemExit) as ended:
        make_parser().parse_args(words)
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--bogus"], "no option --bogus; `catoptra-client walk --help` lists the options"),
        (["--setps=4"], "no option --setps; did you mean --steps?"),
        (["--paecs", "4"], "no option --paecs; did you mean --steps?"),
        (["-pose"], "no option -pose; did you mean --pose?"),
        (["--gait", "trott"], "argument --gait: no 'trott' among trot, gallop; did you mean trot?"),
        (["a", "b\nc"], "'b\\nc' is more than the command takes; `catoptra-client walk --help` "
         "lists the options"),
        (["--paces", "0"], "argument --steps: a number is 1 to 1000000, not 0; "
         "`catoptra-client walk --help` lists the options"),
    ],
)  # fmt: skip
def test_mistake_is_one_line_with_the_remedy(
    capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert read_error(capsys, *words) == f"catoptra-client walk: {message}"


@pytest.mark.parametrize("word", ["--steps", "--paces", "--step", "--pac"])
def test_old_word_and_beginning_of_an_option_are_read(word: str) -> None:
    assert make_parser().parse_args([word, "7"]).steps == 7


def test_value_may_begin_with_a_minus_sign_and_all_may_follow_two() -> None:
    assert make_parser().parse_args(["--pose", "-1,2,0"]).pose == "-1,2,0"
    assert make_parser().parse_args(["--", "--bogus"]).horse == "--bogus"


def test_help_has_every_default_and_no_old_word() -> None:
    text = " ".join(make_parser().format_help().split())
    for part in ("100 % of them (default: 3)", "where (default: here)", "(default: trot)"):
        assert part in text
    assert text.count("(default: yes)") == 1
    assert "paces" not in text


def test_reader_of_a_value_may_raise_an_error_of_ours(capsys: pytest.CaptureFixture[str]) -> None:
    def reject(_: str) -> None:
        raise CatoptraError("no such thing")

    parser = CommandParser("catoptra-client walk")
    parser.add_argument("--thing", type=reject)
    with pytest.raises(SystemExit):
        parser.parse_args(["--thing", "x"])
    assert "argument --thing: no such thing;" in capsys.readouterr().err


def run(command: Callable[[Sequence[str]], int], *words: str) -> int:
    return run_program("catoptra-client", {"walk": "walk"}, lambda _: command, ["walk", *words])


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (CatoptraError("[no]\nway"), 1, "catoptra-client walk: [no] way\n"),
        (OSError(13, "denied", "a.ini"), 1, "catoptra-client walk: [Errno 13] denied: 'a.ini'\n"),
        (KeyboardInterrupt(), 130, "catoptra-client: interrupted\n"),
    ],
)
def test_command_that_fails_ends_with_one_line(
    capsys: pytest.CaptureFixture[str], error: BaseException, status: int, line: str
) -> None:
    def fail(_: Sequence[str]) -> int:
        raise error

    assert run(fail) == status
    assert capsys.readouterr().err == line


def test_bug_keeps_its_traceback() -> None:
    with pytest.raises(ZeroDivisionError):
        run(lambda _: 1 // 0)


PRINTED = """
import sys
from catoptra_protocol.command_line import run_program
def fail(words):
    if words:
        raise BrokenPipeError("the server has gone")
    print(100_000 * "a line of the output\\n")
    return 0
sys.exit(run_program("catoptra-client", {"walk": "walk"}, lambda _: fail, sys.argv[1:]))
"""


@pytest.mark.parametrize(
    ("words", "is_read", "ended"),
    [
        (["walk"], False, (0, "")),
        (["--help"], False, (0, "")),
        # A broken connection is no broken output.
        (["walk", "on"], True, (1, "catoptra-client walk: the server has gone\n")),
    ],
)
def test_output_to_a_reader_that_has_left_ends_without_a_word(
    words: list[str], is_read: bool, ended: tuple[int, str]
) -> None:
    command = [sys.executable, "-c", PRINTED, *words]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        if not is_read:
            process.stdout.close()
        error = process.stderr.read()
    assert (process.returncode, error) == ended


def test_output_to_a_full_disk_fails_with_a_line() -> None:
    with open("/dev/full", "w", encoding="utf-8") as full:
        command = [sys.executable, "-c", PRINTED, "walk"]
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode == 1
    assert ended.stderr == "catoptra-client walk: [Errno 28] No space left on device\n"
