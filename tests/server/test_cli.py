"""The command line, in this process: what does not start ends with 2 and says why."""

from __future__ import annotations

import signal
import socket
from pathlib import Path

import pytest

from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server import cli as module
from catoptra_server.app import ListeningAddress, Options
from catoptra_server.cli import main
from catoptra_server.config.server_file import ServerOptions
from catoptra_server.frames.multi_view import multi_view_layout
from catoptra_server.render.raster import gl_device
from helpers.configs import (
    FIELD,
    OMNI_ROBOT,
    Edit,
    find_line_number,
    write_edited_copy,
    write_small_world,
)
from helpers.server_process import write_small_robot

FREE_PORTS = ("--control-port", "0", "--image-port", "0")


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Return what a server that does not start says, one line on stderr."""
    assert main([*arguments]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    line, end, rest = said.err.partition("\n")
    assert (end, rest) == ("\n", "")
    assert line.startswith("catoptra-server: ")
    return line.removeprefix("catoptra-server: ")


def test_robot_when_broken_is_refused_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, Edit("C=2.321", "C=two"))
    said = refusal(capsys, "--robot", str(path), "--world", str(FIELD))
    assert (
        said
        == f"{path}:{find_line_number(path, 'C=two')}: C='two': expected a number of at least 0"
    )


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "a file that exists"),
        (b"", "a readable mesh file"),
        (b"\x00\x01garbage" * 100, "a readable mesh file"),
        (b"glTF\x02\x00\x00\x00\xff\xff\xff\xff", "a readable mesh file"),
    ],
    ids=["missing", "empty", "garbage", "cut off"],
)
def test_mesh_when_it_cannot_be_read_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes | None, expected: str
) -> None:
    if content is not None:
        (tmp_path / "m.glb").write_bytes(content)
    world = write_small_world(tmp_path, "Meshes=(File=m.glb)")
    said = refusal(capsys, "--robot", str(OMNI_ROBOT), "--world", str(world))
    assert str(tmp_path) in said
    assert "m.glb" in said
    assert f"expected {expected}" in said


@pytest.mark.parametrize("option", ["--robot", "--world"])
def test_file_when_missing_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    files = {"--robot": str(OMNI_ROBOT), "--world": str(FIELD), option: str(tmp_path / "no.ini")}
    said = refusal(capsys, *(part for pair in files.items() for part in pair))
    assert said.startswith(f"{tmp_path / 'no.ini'}: file=")
    assert "a readable ini file" in said


@pytest.mark.parametrize("option", ["--control-port", "--image-port"])
def test_port_when_in_use_is_refused_with_a_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        ports = {"--control-port": "0", "--image-port": "0", option: port}
        said = refusal(
            capsys,
            *(
                "--robot",
                str(write_small_robot(tmp_path)),
                "--world",
                str(write_small_world(tmp_path)),
            ),
            *("--renderer", "trace", "--threads", "1"),
            *(part for pair in ports.items() for part in pair),
        )
    assert "address already in use" in said
    assert port in said
    assert "--control-port 0 --image-port 0 take free ones" in said


def test_raster_when_there_is_no_opengl_is_refused_with_the_packages(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gl_device, "EGL_LIBRARY", "libabsent.so.1")
    said = refusal(
        capsys,
        *("--robot", str(write_small_robot(tmp_path)), "--world", str(write_small_world(tmp_path))),
        *("--renderer", "raster", *FREE_PORTS),
    )
    assert "libabsent.so.1 cannot be loaded" in said
    assert "install libgl1 libegl1 libgl1-mesa-dri" in said


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("--robot", "x"),
        ("--robot", "x", "--world", "y", "--control-port", "65536"),
        ("--robot", "x", "--world", "y", "--image-port", "-1"),
        ("--robot", "x", "--world", "y", "--image-port", "http"),
        ("--robot", "x", "--world", "y", "--image-type", "PNG"),
        ("--robot", "x", "--world", "y", "--renderer", "vulkan"),
        ("--robot", "x", "--world", "y", "--clock", "sundial"),
        ("--robot", "x", "--world", "y", "--threads", "-1"),
        ("--robot", "x", "--world", "y", "--seed", "one"),
        ("--robot", "x", "--world", "y", "--frame-skip", "0"),
        ("--robot", "x", "--world", "y", "--multi-view", "2x2"),
        ("--robot", "x", "--world", "y", "--multi-view", "0x2:320x240"),
        ("--robot", "x", "--world", "y", "--multi-view", "300x1:320x240"),
    ],
)
def test_arguments_when_wrong_are_refused_with_usage(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert "usage: catoptra-server" in capsys.readouterr().err


def test_help_when_asked_for_names_every_option(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    said = capsys.readouterr().out
    for option in ("--robot", "--world", "--host", "--renderer", "--clock", "--seed"):
        assert option in said


def test_server_when_it_listens_prints_where_and_ends_with_0(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def announce_and_end(listening: object) -> None:
        announce(listening)  # type: ignore[arg-type] # it is what it was
        signal.raise_signal(signal.SIGTERM)

    announce = module._print_addresses
    monkeypatch.setattr(module, "_announce", announce_and_end)
    status = main(
        [
            *(
                "--robot",
                str(write_small_robot(tmp_path)),
                "--world",
                str(write_small_world(tmp_path)),
            ),
            *("--renderer", "trace", "--threads", "1", *FREE_PORTS),
        ]
    )
    said = capsys.readouterr().out
    assert status == 0
    assert said.startswith("listening control=127.0.0.1:")
    assert said.count("\n") == 1


def options_of(*arguments: str) -> Options:
    """Return what a command line of two files and these arguments says."""
    parsed = module._build_parser().parse_args(["--robot", "r.ini", "--world", "w.ini", *arguments])
    return module._make_options(parsed)[0]


def test_command_line_when_it_says_nothing_leaves_the_say_to_files() -> None:
    assert options_of().server_options == {}


def test_command_line_when_it_speaks_of_the_server_is_understood() -> None:
    options = options_of(
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


def test_command_line_when_it_turns_a_dial_counts_more_than_files() -> None:
    options = options_of("--max-error-px", "0.5", "--budget-ms", "0")
    assert (options.max_error_px, options.budget_ms) == (0.5, 0.0)
    assert options_of().max_error_px is None


def test_image_port_when_there_is_none_is_announced_as_off(
    capsys: pytest.CaptureFixture[str],
) -> None:
    module._print_addresses(ListeningAddress("127.0.0.1", 1, None, 2))
    assert capsys.readouterr().out == (
        "listening control=127.0.0.1:1 image=off stream=127.0.0.1:2\n"
    )
