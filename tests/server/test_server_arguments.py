"""Words of the command line to options: wrong ones are rejected in plain words, with status 2."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.__main__ import COMMANDS
from catoptra_server.commands.serve import parse_arguments
from catoptra_server.commands.server import Options
from catoptra_server.config.server_file import ServerOptions
from catoptra_server.frames.multi_view import multi_view_layout

FILES = ("--robot", "r.ini", "--world", "w.ini")


@pytest.mark.parametrize(
    "arguments",
    [
        ("--control-port", "65536"),
        ("--image-port", "-1"),
        ("--image-port", "http"),
        ("--image-type", "PNG"),
        ("--renderer", "vulkan"),
        ("--instruction-set", "mmx"),
        ("--clock", "sundial"),
        ("--threads", "-1"),
        ("--seed", "one"),
        ("--threads", "all"),
        ("--frame-skip", "few"),
        ("--max-connections", "many"),
        ("--idle-timeout", "soon"),
        ("--budget-ms", "fast"),
        ("--max-error-px", "inf"),
        ("--memory-limit-mib", "lots"),
        ("--robot", "p2at_omn"),
        ("--world", "nowhere"),
        ("--frame-skip", "0"),
        ("--max-connections", "0"),
        ("--handshake-timeout", "-1"),
        ("--idle-timeout", "nan"),
        ("--memory-limit-mib", "0"),
        ("--memory-limit-mib", "1073741824"),
        ("--multi-view", "1000x1000:4x4"),
        ("--view", "70000"),
        ("--view", "0", "--no-view"),
        ("--multi-view", "2x2"),
        ("--multi-view", "0x2:320x240"),
        ("--multi-view", "300x1:320x240"),
    ],
)
def test_argument_when_wrong_is_rejected_by_its_option_in_plain_words(
    capfd: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    with pytest.raises(SystemExit) as ended:
        parse_arguments([*FILES, *arguments])
    assert ended.value.code == 2
    line, pointer, rest = capfd.readouterr().err.split("\n")
    assert line.startswith("catoptra-server: argument --")
    # argparse prints the name of a function that raises ValueError.
    assert not re.search(r"parse_|partial|<|invalid int|invalid float", line)
    assert pointer == "`catoptra-server --help` lists the options"
    assert not rest


def test_help_when_printed_names_every_option(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        parse_arguments(["--help"])
    assert ended.value.code == 0
    text = capfd.readouterr().out
    for option in ("--robot", "--world", "--renderer", "--instruction-set", "--clock", "--seed"):
        assert option in text
    for command in (*COMMANDS, "--version"):
        assert f"\n  {command} " in text


@pytest.mark.parametrize(
    ("words", "option", "name"),
    [
        ([], "--robot", "p2at_omni"),
        (["--world", "w.ini"], "--robot", "p2at_omni"),
        (["--robot", "r.ini"], "--world", "four_legged_2006"),
    ],
)
def test_file_when_not_given_is_requested_with_the_bundled_names(
    capfd: pytest.CaptureFixture[str], words: list[str], option: str, name: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        parse_arguments(words)
    assert ended.value.code == 2
    line = capfd.readouterr().err
    assert f"{option} is missing" in line
    assert name in line
    assert "catoptra-server list" in line


def parse_options(*arguments: str) -> Options:
    """Options of a command line with two files and these arguments."""
    return parse_arguments([*FILES, *arguments])[0]


def test_command_line_without_options_leaves_all_to_files() -> None:
    assert parse_options().server_options == {}


def test_command_line_with_server_options_is_read() -> None:
    options = parse_options(
        *("--image-port", "7", "--image-type", "raw", "--no-legacy-images", "--frame-skip", "6"),
        *("--multi-view", "4x1:320x240", "--server-ini", "s.ini"),
    )
    assert options.server_file == Path("s.ini")
    assert options.server_options == ServerOptions(
        has_images=True,
        image_port=7,
        image_type=ImageType.RAW,
        legacy_images=False,
        frame_skip=6,
        multi_view=multi_view_layout(4, 1, width_px=320, height_px=240),
    )


def test_command_line_with_limits_of_connections_is_read() -> None:
    options = parse_options(
        *("--max-connections", "8", "--handshake-timeout", "0", "--idle-timeout", "2.5")
    )
    assert options.server_options == ServerOptions(
        max_connections=8,
        max_image_connections=8,
        handshake_timeout_s=0.0,
        idle_timeout_s=2.5,
    )


def test_command_line_with_an_accuracy_target_is_read() -> None:
    options = parse_options("--max-error-px", "0.5", "--budget-ms", "0")
    assert (options.max_error_px, options.budget_ms) == (0.5, 0.0)
    assert parse_options().max_error_px is None


def test_command_line_with_a_memory_limit_is_read() -> None:
    assert parse_options("--memory-limit-mib", "4096").memory_limit_mib == 4096
    assert parse_options().memory_limit_mib == 1024


def test_instruction_set_when_named_reaches_the_options() -> None:
    assert parse_options("--instruction-set", "avx2").instruction_set == "avx2"
    assert parse_options().instruction_set == "auto"


@pytest.mark.parametrize(
    ("words", "has_view", "port"),
    [
        ((), True, None),
        (("--view", "0"), True, 0),
        (("--view", "5081"), True, 5081),
        (("--no-view",), False, None),
    ],
)
def test_view_options_reach_the_options(
    words: tuple[str, ...], has_view: bool, port: int | None
) -> None:
    options = parse_options(*words)
    assert (options.has_view, options.view_port) == (has_view, port)
