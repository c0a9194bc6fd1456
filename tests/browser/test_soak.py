"""Memory of page and server with every panel open: one minute, or ten with LONG=yes."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from browser.chromium import Browser
from browser.devtools import pause
from browser.live_server import start_live_server, write_full_robot
from browser.measured_requirements import MeasuredRequirements
from browser.stream_probe import connect_probe
from browser.tab import open_tab
from helpers.memory import resident_mb

# Panels draw only in view: one window with room for all of them.
WIDTH_PX, HEIGHT_PX = 1400, 3200
# Kept lists (statistics, paths, plots) fill for a while.
_WARM_UP_S = 15.0
_NUM_SAMPLES = 12
_MAX_PAGE_MB = 3.0
_MAX_SERVER_MB = 10.0


def _growth(times_s: list[float], values_mb: list[float]) -> float:
    """Growth over the measurement, in MB, by a straight line through all samples."""
    slope, _ = np.polyfit(times_s, values_mb, 1)
    return float(slope * (times_s[-1] - times_s[0]))


def test_memory_when_all_panels_are_open_is_flat(
    browser: Browser,
    tmp_path: Path,
    pytestconfig: pytest.Config,
    requirements: MeasuredRequirements,
) -> None:
    duration_s = float(pytestconfig.getoption("--soak-seconds"))
    times_s: list[float] = []
    page_mb: list[float] = []
    server_mb: list[float] = []
    with (
        start_live_server(tmp_path, write_full_robot(tmp_path)) as live,
        connect_probe(live.server.stream_port) as owner,
        open_tab(browser, new_window=True) as tab,
    ):
        name = owner.spawn("Circling", -0.5, 0.0)
        owner.drive(1.0, 1.4)
        tab.emulate(width=WIDTH_PX, height=HEIGHT_PX)
        tab.open(live.url)
        tab.wait_for("instruments.frames.length >= 20", "20 pictures", 30.0)
        pause(min(_WARM_UP_S, duration_s / 2.0))
        frames = tab.evaluate("catoptra.statistics.frames_drawn")
        begin_s = time.monotonic()
        for _ in range(_NUM_SAMPLES):
            pause(max(0.0, duration_s - _WARM_UP_S) / _NUM_SAMPLES)
            tab.evaluate("instruments.frames.length = 0; undefined")
            owner.publish("ekf", f'{{"pose": [0, 0, 0], "text": "{name}"}}')
            times_s.append(time.monotonic() - begin_s)
            page_mb.append(tab.heap_mb())
            server_mb.append(resident_mb(live.server.process.pid))
        drawn = tab.evaluate("catoptra.statistics.frames_drawn") - frames
        assert tab.log.messages == []
    page_growth_mb, server_growth_mb = _growth(times_s, page_mb), _growth(times_s, server_mb)
    requirements.check(
        f"memory flat with every panel open for {duration_s:.0f} s",
        f"page {page_mb[0]:.1f} to {page_mb[-1]:.1f} MB (trend {page_growth_mb:+.1f}), server "
        f"{server_mb[0]:.0f} to {server_mb[-1]:.0f} MB ({server_growth_mb:+.1f}), {drawn} pictures",
        is_met=drawn > 2 * times_s[-1]
        and page_growth_mb < _MAX_PAGE_MB
        and server_growth_mb < _MAX_SERVER_MB,
    )
