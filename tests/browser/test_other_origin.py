"""A page of another site in the same browser: nothing that it sends moves a robot or the clock."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from browser.chromium import Browser
from browser.live_server import start_live_server, write_plain_robot
from browser.stream_probe import connect_probe
from browser.tab import open_tab
from browser.test_devtools import serve_page

_PAGE = """<!doctype html><html lang="en"><title>Other</title><link rel="icon" href="data:,">"""
_LINES = (
    "STEPPER\\r\\nINIT {ClassName USARBot.OmniP2AT} {Name Intruder} {Location 1,1,0}\\r\\n"
    "DRIVE {Left 5} {Right 5}\\r\\nSTEP {Time 1}\\r\\nOK\\r\\n"
)
_MESSAGES = (
    {"kind": "spawn", "id": 1, "class_name": "USARBot.OmniP2AT", "name": "Intruder",
     "location_m": [1.0, 1.0, 0.0], "rotation_rad": None, "start": None},
    {"kind": "step", "id": 2, "time_s": 1.0},
)  # fmt: skip
# Every form of request that a page may send without asking the server first, then a WebSocket.
_ATTACK = """(async (ports, lines, messages) => {
  const outcomes = [];
  for (const port of ports) {
    const address = `http://127.0.0.1:${port}/socket`;
    const forms = ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data"];
    for (const type of forms) {
      const headers = { "Content-Type": type };
      const signal = AbortSignal.timeout(2000);
      const options = { method: "POST", mode: "no-cors", body: lines, headers, signal };
      outcomes.push(await fetch(address, options).then((r) => r.type, (e) => e.name));
    }
    outcomes.push(await new Promise((resolve) => {
      const socket = new WebSocket(`ws://127.0.0.1:${port}/socket`);
      setTimeout(() => resolve("silent"), 2000);
      socket.onopen = () => {
        messages.forEach((message) => socket.send(JSON.stringify(message)));
        resolve("open");
      };
      socket.onerror = () => resolve("refused");
    }));
  }
  return outcomes;
})"""


@pytest.mark.parametrize("clock", ["lockstep", "realtime"])
def test_page_of_another_site_changes_nothing(browser: Browser, tmp_path: Path, clock: str) -> None:
    robot = write_plain_robot(tmp_path, size_px=64)
    with (
        start_live_server(tmp_path, robot, "--clock", clock) as live,
        connect_probe(live.server.stream_port) as owner,
        serve_page(_PAGE) as address,
        open_tab(browser, address, new_window=True) as tab,
    ):
        owner.spawn("Standing", 0.5, 0.5)
        before = live.probe.get_state()
        server = live.server
        ports = [server.control_port, server.image_port, server.stream_port, live.view_port]
        arguments = f'({json.dumps(ports)}, "{_LINES}", {json.dumps(_MESSAGES)})'
        outcomes = tab.evaluate(f"{_ATTACK}{arguments}", limit_s=60.0)
        assert len(outcomes) == 4 * len(ports)
        assert "open" not in outcomes
        after = live.probe.get_state()
        assert after.robots == before.robots
        if clock == "lockstep":
            assert after.time_s == before.time_s
        assert "an HTTP request instead of the protocol of this port" in server.log.read_text()
