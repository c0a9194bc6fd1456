"""The page under a lockstep clock: time passes by its button, and pictures follow time."""

from __future__ import annotations

from pathlib import Path

import pytest

from browser.chromium import Browser
from browser.devtools import pause, wait_until
from browser.live_server import start_live_server, write_plain_robot
from browser.stream_probe import connect_probe
from browser.tab import open_tab


def test_step_button_when_pressed_advances_time_and_picture(
    browser: Browser, tmp_path: Path
) -> None:
    robot = write_plain_robot(tmp_path, size_px=360)
    with (
        start_live_server(tmp_path, robot, "--clock", "lockstep") as live,
        connect_probe(live.server.stream_port) as owner,
        open_tab(browser, live.url, new_window=True) as tab,
    ):
        owner.spawn("Stepped", 0.5, 0.5)
        tab.wait_for("instruments.frames.length >= 1", "picture", 15.0)
        pause(1.0)
        # The same moment is the same picture: none is requested twice.
        assert tab.evaluate("instruments.frames.length") == 1
        before_s = live.probe.get_state().time_s
        button = "[...document.querySelectorAll('#panel-drive button')].find((b) => /^Step/.test("
        tab.evaluate(f"{button}b.textContent)).id = 'step'")
        tab.click("#step")
        wait_until(lambda: live.probe.get_state().time_s > before_s, "step", 5.0)
        tab.wait_for("instruments.frames.length >= 2", "picture after the step", 10.0)
        passed_s = live.probe.get_state().time_s - before_s
        assert passed_s == pytest.approx(0.1, abs=1e-6)
