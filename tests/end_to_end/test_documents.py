"""Code blocks of README.md and client/README.md, as a reader runs them, against a server process.

The blocks of a document share their names, as in a program that has been copied block by block.
Only ports differ, and a loop without end is interrupted after a few lines, as by Ctrl-C.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from catoptra_client import __main__ as client_program
from catoptra_client.frame import rgb_from_image_bytes
from helpers.configs import REPOSITORY
from helpers.documents import find_commands, read_blocks
from helpers.server_process import DEADLINE_S, RunningServer, start_server

README = REPOSITORY / "README.md"
CLIENT_README = REPOSITORY / "client/README.md"
MAX_LINES = 6
# NumPy pads short numbers by spaces, in front of the bracket too.
POSE = re.compile(r"\[\s*(\S+)\s+(\S+)\s+(\S+?)\s*\]")


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Server with the files of the documents' own command."""
    folder = tmp_path_factory.mktemp("documents")
    (words,) = {
        tuple(words[1:])
        for path in (README, CLIENT_README)
        for words in find_commands(path.read_text(encoding="utf-8"))
        if words[0] == ".venv/bin/catoptra-server"
    }
    options = dict(zip(words[::2], words[1::2], strict=True))
    assert set(options) == {"--robot", "--world"}
    robot, world = (REPOSITORY / options[name] for name in ("--robot", "--world"))
    with pytest.MonkeyPatch.context() as environment:
        # Without costs of frames that an earlier server has measured.
        environment.setenv("XDG_CACHE_HOME", str(folder))
        with start_server(folder, "--verbose", robot=robot, world=world) as running:
            yield running


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Current folder with the repository's configurations."""
    (tmp_path / "configs").symlink_to(REPOSITORY / "configs")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_blocks(path: Path, server: RunningServer) -> list[list[str]]:
    """Lines that each Python block of a document prints, in order."""
    names: dict[str, Any] = {}
    return [_run_block(block, names, server) for block in read_blocks(path, "python")]


def _run_block(block: str, names: dict[str, Any], server: RunningServer) -> list[str]:
    lines: list[str] = []

    def print_line(*words: object) -> None:
        lines.append(" ".join(map(str, words)))
        if len(lines) == MAX_LINES:
            raise KeyboardInterrupt

    source = block.replace("5005", str(server.stream_port))
    for client, port in (("Robot", server.control_port), ("Image", server.image_port)):
        source = source.replace(
            f"{client}Client.connect()",
            f"{client}Client.connect(port={port}, timeout_s={DEADLINE_S})",
        )
    names["print"] = print_line
    with contextlib.suppress(KeyboardInterrupt):
        exec(compile(source, "block", "exec"), names)
    return lines


def run_client(server: RunningServer, words: list[str]) -> None:
    """Run a command of the client with the server's ports."""
    ports = {"--stream-port": server.stream_port}
    if words[1] != "snapshot":
        ports = {"--control-port": server.control_port, "--image-port": server.image_port}
    options = (f"{name}={port}" for name, port in ports.items())
    assert client_program.main([*words[1:], *options]) == 0, shlex.join(words)


def test_blocks_of_the_readme_drive_and_receive_frames(server: RunningServer, folder: Path) -> None:
    (lines,) = run_blocks(README, server)
    assert len(lines) == MAX_LINES
    assert all(line.startswith("<Frame ") and "OdometryReading" in line for line in lines)


def test_blocks_of_the_client_page_are_one_program(server: RunningServer, folder: Path) -> None:
    commands = list(find_commands(CLIENT_README.read_text(encoding="utf-8")))
    (train,) = (words for words in commands if words[1:2] == ["train"])
    # A third of the frames: enough for the beacons, in three seconds.
    run_client(server, [*train, "--frames", "10"])
    bearings, localized, published, streamed, framed = run_blocks(CLIENT_README, server)
    assert any("cyan" in line for line in bearings)
    x, y, heading = map(float, POSE.match(localized[-1]).groups())  # type: ignore[union-attr]
    # A second at 0.17 m/s, turning right by 0.3 rad: near the start, and not at it.
    assert 0.0 < x < 0.5
    assert abs(y) < 0.2
    assert 0.0 < heading < 1.0
    assert published == []
    assert len(streamed) == MAX_LINES
    assert framed[0].startswith("<Frame ")
    assert "'OmniCamPillar_Link4'" in framed[0]


def test_snapshots_of_the_client_page_are_written(server: RunningServer, folder: Path) -> None:
    with server.connect_stream() as client:
        client.spawn("USARBot.OmniP2AT", name="A", start_pose="Centre")
        for words in find_commands(CLIENT_README.read_text(encoding="utf-8")):
            if words[1:2] == ["snapshot"]:
                run_client(server, words)
    for name in ("view.png", "around.png"):
        assert rgb_from_image_bytes((folder / name).read_bytes()).std() > 10.0
    assert sorted(os.listdir(folder)) == ["around.png", "configs", "view.png"]


def test_log_of_a_server_has_no_dict(server: RunningServer, folder: Path) -> None:
    with server.connect_stream() as client:
        client.spawn("USARBot.OmniP2AT", name="Logged", start_pose="Centre")
        client.set_accuracy(max_error_px=0.5)
        client.publish("ekf", {"pose": (1.0, 2.0, 3.0)})
        client.get_frame()
    log = server.log.read_text()
    assert "Logged" in log
    assert "costs of trace measured" in log
    # Dicts of Python, not the braces of USARSim's messages and of JSON.
    assert not re.search(r"\{\S*'?: ", log)
