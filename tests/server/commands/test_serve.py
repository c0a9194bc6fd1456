"""Words of the command line to options, and starts that fail with status 1 and the reason."""

from __future__ import annotations

import asyncio
import errno
import re
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.commands import COMMANDS
from catoptra_server.commands import serve as serve_module
from catoptra_server.commands.serve import main, parse_arguments
from catoptra_server.commands.server import ListeningAddress, Options, serve
from catoptra_server.config.server_file import ServerOptions
from catoptra_server.frames.multi_view import multi_view_layout
from catoptra_server.render.raster import device as gl_device
from catoptra_server.runtime.faults import Termination
from catoptra_server.runtime.worker_thread import ThreadFailedError
from helpers.configs import (
    FIELD,
    OMNI_ROBOT,
    Edit,
    find_line_number,
    write_edited_copy,
    write_small_world,
)
from helpers.server_process import write_small_robot

FILES = ("--robot", "r.ini", "--world", "w.ini")


@pytest.mark.parametrize(
    "arguments",
    [
        ("--control-port", "65536"),
        ("--image-port", "-1"),
        ("--image-port", "http"),
        ("--image-type", "PNG"),
        ("--renderer", "vulkan"),
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
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("catoptra-server: argument --")
    # argparse prints the name of a function that raises ValueError.
    assert not re.search(r"parse_|partial|<|invalid int|invalid float", line)


def test_help_when_printed_names_every_option(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        parse_arguments(["--help"])
    assert ended.value.code == 0
    text = capfd.readouterr().out
    for option in ("--robot", "--world", "--renderer", "--clock", "--seed"):
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
        max_connections=8, max_image_connections=8, handshake_timeout_s=0.0, idle_timeout_s=2.5
    )


@pytest.mark.parametrize(
    ("words", "name", "value", "default"),
    [
        (("--max-error-px", "0.5"), "max_error_px", 0.5, None),
        (("--budget-ms", "0"), "budget_ms", 0.0, None),
        (("--memory-limit-mib", "4096"), "memory_limit_mib", 4096, 1024),
    ],
)
def test_option_when_named_is_read_and_else_its_default(
    words: tuple[str, ...], name: str, value: object, default: object
) -> None:
    assert getattr(parse_options(*words), name) == value
    assert getattr(parse_options(), name) == default


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


FREE_PORTS = ("--control-port", "0", "--image-port", "0")


def name_small_files(folder: Path) -> tuple[str, ...]:
    """Options that name a small robot and a small world."""
    robot, world = write_small_robot(folder), write_small_world(folder)
    return "--robot", str(robot), "--world", str(world)


def serve_words(*arguments: str) -> int:
    """Exit status of the server for a command line; signals are left to pytest."""
    return main(arguments, Termination())


def start_error(capfd: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The last line on stderr of a server that does not start, after those of the log."""
    assert serve_words(*arguments) == 1
    output = capfd.readouterr()
    assert output.out == ""
    *log_lines, line = output.err.splitlines()
    assert not any("Traceback" in other for other in log_lines)
    assert line.startswith("catoptra-server: ")
    return line.removeprefix("catoptra-server: ")


def test_robot_when_broken_is_rejected_with_its_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, Edit("C=2.321", "C=two"))
    line = start_error(capfd, "--robot", str(path), "--world", str(FIELD))
    assert (
        line
        == f"{path}:{find_line_number(path, 'C=two')}: C='two': expected a number of at least 0"
    )


@pytest.mark.parametrize("option", ["--robot", "--world"])
def test_file_when_missing_is_rejected(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], option: str
) -> None:
    files = {"--robot": str(OMNI_ROBOT), "--world": str(FIELD), option: str(tmp_path / "no.ini")}
    line = start_error(capfd, *(part for pair in files.items() for part in pair))
    assert line.startswith(f"{tmp_path / 'no.ini'}: file=")
    assert "a readable ini file" in line


@pytest.mark.parametrize("option", ["--control-port", "--image-port", "--view"])
def test_port_when_in_use_is_rejected_with_a_remedy(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], option: str
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as occupied:
        port = str(occupied.getsockname()[1])
        ports = {"--control-port": "0", "--image-port": "0", option: port}
        line = start_error(
            capfd,
            *name_small_files(tmp_path),
            *("--renderer", "trace", "--threads", "1"),
            *(part for pair in ports.items() for part in pair),
        )
    assert f"127.0.0.1:{port}: Address already in use" in line
    assert "--control-port 0 --image-port 0 --view 0 take free ones" in line


# TEST-NET-3 of RFC 5737 is the address of no machine; .invalid resolves nowhere (RFC 6761).
@pytest.mark.parametrize("host", ["203.0.113.9", "no-such-host.invalid"])
def test_host_that_is_not_this_machine_is_not_taken_for_a_port_in_use(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], host: str
) -> None:
    line = start_error(
        capfd,
        *name_small_files(tmp_path),
        *("--renderer", "trace", "--threads", "1", "--host", host, *FREE_PORTS),
    )
    assert f"control port {host}:0: " in line
    assert "--host is a name or an address of this machine" in line
    assert "another server" not in line


def test_raster_when_there_is_no_opengl_is_rejected_with_the_packages(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gl_device, "EGL_LIBRARY", "libabsent.so.1")
    line = start_error(
        capfd,
        *name_small_files(tmp_path),
        *("--renderer", "raster", *FREE_PORTS),
    )
    assert "libabsent.so.1 cannot be loaded" in line
    assert "install libgl1 libegl1 libgl1-mesa-dri" in line


def test_server_when_it_listens_prints_its_addresses_and_ends_with_0(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def serve_and_end(
        options: Options, announce: Callable[[ListeningAddress], None], stop: asyncio.Event
    ) -> None:
        def announce_and_end(address: ListeningAddress) -> None:
            announce(address)
            stop.set()

        await serve(options, announce_and_end, stop)

    monkeypatch.setattr(serve_module, "serve", serve_and_end)
    status = serve_words(
        *name_small_files(tmp_path),
        *("--renderer", "trace", "--threads", "1", *FREE_PORTS),
    )
    text = capfd.readouterr().out
    assert status == 0
    first, second, rest = text.split("\n")
    assert first.startswith("listening control=127.0.0.1:")
    assert second.startswith("live page: http://127.0.0.1:")
    assert not rest


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (ThreadFailedError("the simulation thread failed"), "the simulation thread failed"),
        (OSError("too many open files"), "cannot listen: too many open files"),
        (UnicodeError("label empty"), "no name that can exist (label empty). --host"),
        (OSError(errno.EACCES, "port 80: denied"), "denied. Ports below 1024 need privileges"),
        (OSError(errno.EMFILE, "too many"), "too many. The process has no free"),
        (ZeroDivisionError(), "CRITICAL catoptra_server.commands.serve: the server ends: a bug"),
    ],
    ids=["thread", "port", "host", "privileges", "descriptors", "bug"],
)
def test_error_that_ends_the_server_has_its_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    error: Exception,
    line: str,
) -> None:
    async def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(serve_module, "serve", fail)
    assert serve_words("--robot", "p2at_omni", "--world", "four_legged_2006") == 1
    assert line in capfd.readouterr().err


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--memory-limit-mib", "50"), "ResolutionX='360 x 360 px, Samples=2'"),
        (("--multi-view", "1x1:4000x4000"), "='a tile of 4000 x 4000 px'"),
    ],
)
def test_camera_beyond_the_memory_limit_is_rejected(
    capfd: pytest.CaptureFixture[str], options: tuple[str, ...], expected: str
) -> None:
    line = start_error(capfd, "--robot", "p2at_omni", "--world", str(FIELD), *options)
    assert expected in line


def test_image_port_when_there_is_none_is_announced_as_off(
    capfd: pytest.CaptureFixture[str],
) -> None:
    serve_module._print_addresses(ListeningAddress("127.0.0.1", 1, None, 2))
    assert capfd.readouterr().out == (
        "listening control=127.0.0.1:1 image=off stream=127.0.0.1:2\n"
    )


def test_link_of_the_page_is_the_second_line(capfd: pytest.CaptureFixture[str]) -> None:
    link = "http://localhost:5080/?token=secret"
    serve_module._print_addresses(ListeningAddress("0.0.0.0", 1, 3, 2, link))
    assert capfd.readouterr().out == (
        f"listening control=0.0.0.0:1 image=0.0.0.0:3 stream=0.0.0.0:2\nlive page: {link}\n"
    )
