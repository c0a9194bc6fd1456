"""The player, against our own server process and against servers that do wrong."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from conformance.conversation import STEPS, Conversation, hold, read_conversation
from conformance.play import CONVERSATIONS, Verdict, conversations, main, table
from helpers.server_process import running_server

ALL = conversations()


def test_our_server_when_all_conversations_are_played_passes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with running_server(tmp_path, "--image-type", "GOOD") as server:
        control, image = f"127.0.0.1:{server.control_port}", f"127.0.0.1:{server.image_port}"
        status = main([control, "--image", image])
    assert status == 0, capsys.readouterr().out


def test_conversations_when_read_use_every_kind_of_step() -> None:
    assert {key for one in ALL for step in one.steps for key in step} >= set(STEPS)
    assert {one.port for one in ALL} == {"control", "image"}


def test_conversation_when_it_has_an_unknown_key_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "wrong.json"
    path.write_text('{"why": "", "port": "control", "steps": [{"expcet": []}]}')
    with pytest.raises(ValueError, match="expcet"):
        read_conversation(path)


@contextmanager
def deaf_server() -> Iterator[tuple[str, int]]:
    """Accept one connection, say one line and close it."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            connection, _ = listener.accept()
            with connection:
                connection.sendall(b"NFO {Gametype A} {Level B} {TimeLimit 0}\r\n")

        thread = threading.Thread(target=serve)
        thread.start()
        yield listener.getsockname()
        thread.join()


def test_hold_when_the_server_closes_says_at_which_step() -> None:
    steps = ({"expect": ["NFO .*"]}, {"expect": ["STA .*"]})
    with deaf_server() as address:
        reason = hold(Conversation("c", "", "control", True, steps), address, {})
    assert reason == "step 2 (expect): the server closed the connection"


def test_verdict_when_the_conversation_is_not_required_is_no_failure() -> None:
    optional = Conversation("c", "", "control", False, ())
    assert not Verdict(optional, "step 1").is_failure
    assert Verdict(Conversation("c", "", "control", True, ()), "step 1").is_failure
    assert table([Verdict(optional, "step [1]")]).row_count == 1


def test_conversations_when_listed_are_all_files_of_the_folder() -> None:
    assert len(ALL) == len(list(CONVERSATIONS.iterdir()))
