"""Lost servers, several pages, and clients with hostile names or messages."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import aiohttp

from browser.chromium import Browser
from browser.devtools import LoopThread
from browser.live_server import LiveServer, start_live_server, write_plain_robot
from browser.stream_probe import connect_probe
from browser.tab import Tab, open_tab
from browser.test_driving import select_robot

_HTML_NAME = "<img_src=x_onerror=alert(1)><b>bold"


def _wait_for_new_frames(tab: Tab, count: int = 10) -> None:
    tab.evaluate("instruments.frames.length = 0; undefined")
    tab.wait_for(f"instruments.frames.length >= {count}", f"{count} pictures", 15.0)


def test_page_when_the_server_restarts_goes_on(browser: Browser, tmp_path: Path) -> None:
    robot = write_plain_robot(tmp_path)
    with open_tab(browser, new_window=True) as tab:
        with (
            start_live_server(tmp_path / "first", robot) as live,
            connect_probe(live.server.stream_port) as owner,
        ):
            port = live.view_port
            owner.spawn("Before", 0.5, 0.5)
            tab.open(live.url)
            _wait_for_new_frames(tab)
        tab.wait_for("!document.getElementById('notice').hidden", "notice of the loss", 5.0)
        assert "connection" in tab.evaluate("document.getElementById('notice').textContent")
        with (
            start_live_server(tmp_path / "second", robot, view_port=port) as live,
            connect_probe(live.server.stream_port) as owner,
        ):
            owner.spawn("After", 0.5, 0.5)
            _wait_for_new_frames(tab)
            tab.wait_for("document.getElementById('notice').hidden", "end of the notice", 10.0)
            assert tab.evaluate("instruments.frames.at(-1).robot") == "After"


def test_pages_when_two_are_open_show_each_others_robots(
    browser: Browser, live: LiveServer
) -> None:
    with (
        open_tab(browser, live.url, new_window=True) as first,
        open_tab(browser, live.url, new_window=True) as second,
        connect_probe(live.server.stream_port) as foreign,
    ):
        foreign.spawn("Foreign", -1.2, -1.2)
        for tab in (first, second):
            names = "catoptra.context.state?.reply.robots.map(({ name }) => name)"
            tab.wait_for(f"{names}?.includes('Foreign')", "foreign robot", 5.0)
        select_robot(first, "Foreign")
        first.wait_for("instruments.frames.at(-1)?.robot === 'Foreign'", "its picture", 5.0)
        assert second.evaluate("catoptra.context.selected.robot") == "Standing"
        _wait_for_new_frames(second)


def test_names_when_they_are_markup_stay_text(browser: Browser, live: LiveServer) -> None:
    with (
        connect_probe(live.server.stream_port) as hostile,
        open_tab(browser, new_window=True) as tab,
    ):
        name = hostile.spawn(_HTML_NAME, 0.0, -1.5)
        note = {"text": "<script>window.stolen = 1</script><img src=x onerror='window.stolen=1'>"}
        hostile.publish("<i>note</i>", json.dumps(note))
        tab.open(live.url)
        _wait_for_new_frames(tab)
        select_robot(tab, name)
        tab.wait_for(f"instruments.frames.at(-1)?.robot === {name!r}", "its picture", 5.0)
        tab.wait_for("document.body.innerText.includes('onerror')", "the name as text", 5.0)
        # The swatches of the map's plan are `i`, and come with the plan.
        elements = "document.querySelectorAll('img, b, i:not(.layers i), body script')"
        assert tab.evaluate(f"{elements}.length") == 0
        assert tab.evaluate("window.stolen") is None
        assert tab.log.messages == []


def test_page_when_others_send_garbage_keeps_drawing(browser: Browser, live: LiveServer) -> None:
    with open_tab(browser, live.url, new_window=True) as tab:
        _wait_for_new_frames(tab)
        with _attack(live):
            for _ in range(3):
                _wait_for_new_frames(tab)
        _wait_for_new_frames(tab)
        assert tab.log.messages == []


@contextmanager
def _attack(live: LiveServer) -> Iterator[None]:
    """Open sockets, from foreign pages too, and send malformed and oversized messages."""
    stopped = threading.Event()
    with LoopThread() as thread:
        future = thread.submit(_send_garbage(live.url, stopped))
        try:
            yield
        finally:
            stopped.set()
            assert future.result(30.0) > 0


async def _send_garbage(url: str, stopped: threading.Event) -> int:
    """Number of connections that were tried."""
    messages = ("{", "[]", "null", '{"kind": "get_frame", "id": 1}', "x" * 100_000, b"\0" * 1000)
    count = 0
    timeout = aiohttp.ClientTimeout(total=5.0)
    async with aiohttp.ClientSession(timeout=timeout) as client:
        while not stopped.is_set():
            count += 1
            origin = "http://attacker.example" if count % 2 else url.rstrip("/")
            try:
                async with client.ws_connect(f"{url}socket", headers={"Origin": origin}) as socket:
                    for message in messages:
                        if isinstance(message, str):
                            await socket.send_str(message)
                        else:
                            await socket.send_bytes(message)
            except (TimeoutError, aiohttp.ClientError, ConnectionError):
                continue
    return count
