"""The server and the clients of the measurements of serving."""

from __future__ import annotations

import pytest

from cost.served_process import FULL_REQUEST, connect_watchers, spawn_robots, start_server


@pytest.mark.parametrize("stand_in_ms", [None, 1.0])
def test_counted_server_counts_the_frames_of_either_transport(stand_in_ms: float | None) -> None:
    with (
        start_server("--renderer", "trace", size_px=16, stand_in_ms=stand_in_ms) as server,
        spawn_robots(server, 1),
        connect_watchers(server, FULL_REQUEST, b"raw") as watchers,
    ):
        before = server.read_counters()
        for watcher in watchers:
            for _ in range(3):
                watcher.receive_frame()
        window = server.read_counters()
    assert [watcher.num_frames for watcher in watchers] == [3, 3]
    assert len(watchers[0].payload) > len(watchers[1].payload) == 3 * 16**2
    assert window.frames > before.frames
    assert window.process_s > window.serving_s > before.serving_s
