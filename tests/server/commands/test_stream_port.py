"""The port of the stream as a server opens it."""

from __future__ import annotations

from pathlib import Path

import catoptra_server
from helpers.server_process import start_server


def test_stream_of_a_server_states_release_world_and_robots(tmp_path: Path) -> None:
    with start_server(tmp_path) as server, server.connect_stream() as client:
        status = client.get_status()
    assert status.server == f"Catoptra {catoptra_server.__version__}"
    assert status.class_names == ("USARBot.OmniP2AT",)
    assert status.clock == "realtime"
