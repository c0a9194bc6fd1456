"""Baked light in a served world: few rays at first, more in the background, kept on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_server.config.known_names import find_configuration
from helpers.deadline import Deadline
from helpers.server_process import start_server

STAGE = "rays a node, up to 256"


def test_refined_light_is_a_new_picture_and_is_kept_for_the_next_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    world = find_configuration("worlds", "warehouse")
    with start_server(tmp_path, world=world) as server, server.connect_stream() as client:
        client.spawn("USARBot.OmniP2AT", location_m=(0.0, 0.0, 0.0))
        # The robot stands: pictures are repeated, and drawn again once for the rays to come.
        first = frame = client.get_frame(encoding=ImageEncoding.RAW)
        assert STAGE in (first.plan or "")
        # On a busy machine its thread, of the lowest priority, has a fiftieth of a processor.
        deadline = Deadline("finished light", 300.0)
        while STAGE in (frame.plan or ""):
            deadline.check()
            frame = client.get_frame(encoding=ImageEncoding.RAW)
        refined = frame.rgb
        assert 0.0 < np.abs(refined.astype(int) - first.rgb).mean() < 2.0
    files = list((tmp_path / "cache/catoptra/light").iterdir())
    assert len(files) == 1
    assert files[0].stat().st_size < 3 * 2**20
    second = tmp_path / "second"
    second.mkdir()
    with start_server(second, world=world) as server, server.connect_stream() as client:
        client.spawn("USARBot.OmniP2AT", location_m=(0.0, 0.0, 0.0))
        frame = client.get_frame(encoding=ImageEncoding.RAW)
        assert STAGE not in (frame.plan or "")
        np.testing.assert_array_equal(frame.rgb, refined)
