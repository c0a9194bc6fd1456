"""Ten seconds of `make record-soak`."""

from __future__ import annotations

from pathlib import Path

import pytest

from load.record_soak import run_soak


def test_recording_at_full_load_loses_nothing_and_needs_no_more_memory(tmp_path: Path) -> None:
    figures = run_soak(tmp_path, 10.0, viewed_s=0.1)
    assert figures["dropped"] == {}
    assert figures["frames_lost"] == 0
    assert figures["frames"] > 20
    # Each tick, with all eight readings, whatever the machine is busy with.
    assert figures["ticks_recorded"] == pytest.approx(1.0, abs=1e-3)
    assert min(figures["readings_per_s"].values()) > 49.5
    first_mb, last_mb = figures["recorder_mb"]
    assert last_mb < first_mb + 15.0
