"""The player against our own server process, and against servers that misbehave."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from conformance import stream_player, tcp_player
from conformance.conversation_file import Conversation, read_conversation
from conformance.play import (
    CONVERSATIONS,
    PLAYERS,
    STEP_KEYS,
    ConversationResult,
    main,
    read_conversations,
    results_table,
)
from conformance.tcp_player import play_conversation
from helpers.server_process import start_server

ALL_CONVERSATIONS = read_conversations()


@pytest.mark.parametrize(
    ("server_options", "player_options"),
    [
        (("--image-type", "GOOD"), ()),
        (("--dialect", "udk", "--image-type", "RAW"), ("--dialect", "udk")),
        (("--legacy-images",), ("--legacy-images",)),
    ],
    ids=["plain", "udk", "legacy"],
)
def test_our_server_when_all_conversations_are_played_passes(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    server_options: tuple[str, ...],
    player_options: tuple[str, ...],
) -> None:
    with start_server(tmp_path, *server_options) as server:
        control, image = (f"127.0.0.1:{p}" for p in (server.control_port, server.image_port))
        # The stream is the same whatever the dialect: once is enough.
        stream = () if player_options else ("--stream", f"127.0.0.1:{server.stream_port}")
        status = main([control, "--image", image, *stream, *player_options])
    assert status == 0, capsys.readouterr().out


def test_conversations_when_read_use_every_kind_of_step() -> None:
    keys = {key for one in ALL_CONVERSATIONS for step in one.steps for key in step}
    assert keys >= {*tcp_player.STEP_HANDLERS, *stream_player.STEP_HANDLERS}
    assert {one.port for one in ALL_CONVERSATIONS} == set(PLAYERS)


def test_conversations_when_for_one_kind_of_server_are_skipped_for_others() -> None:
    udk = {one.name for one in ALL_CONVERSATIONS if one.applies_to("udk", "legacy")}
    usual = {one.name for one in ALL_CONVERSATIONS if one.applies_to("ut2004", "plain")}
    assert {"udk_status", "image_legacy_first", "greeting", "stream_status"} <= udk
    assert {"ut2004_status", "image_full_frame", "greeting", "stream_status"} <= usual
    assert not {"ut2004_status", "image_full_frame"} & udk
    assert not {"udk_status", "image_legacy_first"} & usual


def test_conversation_when_it_has_an_unknown_key_is_rejected(tmp_path: Path) -> None:
    path = tmp_path / "wrong.json"
    path.write_text('{"description": "", "port": "control", "steps": [{"expcet": []}]}')
    with pytest.raises(ValueError, match="expcet"):
        read_conversation(path, STEP_KEYS)


@contextmanager
def closing_server() -> Iterator[tuple[str, int]]:
    """Accept one connection, send one line and close the connection."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            connection, _ = listener.accept()
            with connection:
                connection.sendall(b"NFO {Gametype A} {Level B} {TimeLimit 0}\r\n")

        thread = threading.Thread(target=serve)
        thread.start()
        yield listener.getsockname()
        thread.join()


def test_play_when_the_server_closes_reports_the_step() -> None:
    steps = ({"expect": ["NFO .*"]}, {"expect": ["STA .*"]})
    with closing_server() as address:
        reason = play_conversation(Conversation("c", "", "control", True, steps), address, {})
    assert reason == "step 2 (expect): the server closed the connection"


def test_result_when_the_conversation_is_not_required_is_no_failure() -> None:
    optional = Conversation("c", "", "control", False, ())
    assert not ConversationResult(optional, "step 1").is_failure
    assert ConversationResult(Conversation("c", "", "control", True, ()), "step 1").is_failure
    assert results_table([ConversationResult(optional, "step [1]")]).row_count == 1


def test_conversations_when_listed_are_all_files_of_the_folder() -> None:
    assert len(ALL_CONVERSATIONS) == len(list(CONVERSATIONS.iterdir()))
