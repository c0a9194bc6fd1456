"""The DevTools client itself, against a small page of the tests' own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from aiohttp import web

from browser.chromium import Browser, start_browser
from browser.devtools import DevToolsError, LoopThread
from browser.tab import open_tab

_PAGE = """<!doctype html><html lang="en"><title>Page</title>
<link rel="icon" href="data:,">
<button id="first">First</button><button id="second">Second</button>
<script>
  const events = [];
  for (const name of ["keydown", "keyup", "click", "touchstart", "mousemove"])
    document.addEventListener(name, (event) => events.push(name + ":" + (event.key ?? "")));
</script>"""


@contextmanager
def serve_page(text: str) -> Iterator[str]:
    """Serve one HTML page on a free loopback port; its address."""

    async def respond(_: web.Request) -> web.Response:
        return web.Response(text=text, content_type="text/html")

    async def start() -> tuple[web.AppRunner, int]:
        application = web.Application()
        application.router.add_get("/", respond)
        runner = web.AppRunner(application)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        return runner, runner.addresses[0][1]

    with LoopThread() as thread:
        runner, port = thread.run(start())
        try:
            yield f"http://127.0.0.1:{port}/"
        finally:
            thread.run(runner.cleanup())


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    with serve_page(_PAGE) as url:
        yield url


def test_tab_when_input_is_sent_receives_the_events(browser: Browser, address: str) -> None:
    with open_tab(browser, address) as tab:
        tab.press("w")
        tab.click("#second")
        assert tab.evaluate("events.filter((e) => !e.startsWith('mousemove'))") == [
            "keydown:w",
            "keyup:w",
            "click:",
        ]
        tab.press("Tab")
        tab.press("Tab", shift=True)
        assert tab.evaluate("document.activeElement.id") == "second"


def test_tab_when_a_phone_is_emulated_receives_touches(browser: Browser, address: str) -> None:
    with open_tab(browser) as tab:
        tab.emulate(width=390, height=844, is_phone=True)
        tab.open(address)
        tab.touch("touchStart", (100.0, 100.0))
        tab.touch("touchEnd")
        assert "touchstart:" in tab.evaluate("events")
        assert tab.evaluate("innerWidth") <= 980


def test_log_when_a_page_fails_has_messages_and_addresses(browser: Browser, address: str) -> None:
    with open_tab(browser, address) as tab:
        assert tab.log.messages == []
        assert tab.log.urls[0] == address
        tab.evaluate("console.error('broken', 1); console.warn('odd'); console.log('fine')")
        tab.evaluate("void fetch('http://example.org/x').catch(() => 0); undefined")
        tab.evaluate("setTimeout(() => { throw new Error('late'); }); undefined")
        tab.wait_for("new Promise((r) => setTimeout(() => r(true), 100))", "timer", 5.0)
        assert tab.log.messages[:2] == ["error: broken 1", "warning: odd"]
        assert any("late" in message for message in tab.log.messages)
        assert "http://example.org/x" in tab.log.urls


def test_evaluate_when_the_script_throws_raises(browser: Browser, address: str) -> None:
    with open_tab(browser, address) as tab, pytest.raises(DevToolsError, match="undefinedName"):
        tab.evaluate("undefinedName + 1")


def test_wait_when_the_condition_stays_false_reaches_its_limit(
    browser: Browser, address: str
) -> None:
    with open_tab(browser, address) as tab, pytest.raises(DevToolsError, match="no miracle"):
        tab.wait_for("false", "miracle", 0.2)


def test_tab_when_another_is_in_front_is_hidden(browser: Browser, address: str) -> None:
    state = "document.visibilityState"
    with open_tab(browser, address, new_window=True) as behind:
        assert behind.evaluate(state) == "visible"
        with open_tab(browser, address):
            behind.wait_for(f"{state} === 'hidden'", "hidden tab", 5.0)
            with open_tab(browser, address, new_window=True):
                assert behind.evaluate(state) == "hidden"
        behind.activate()
        behind.wait_for(f"{state} === 'visible'", "visible tab", 5.0)


def test_screenshot_and_heap_are_of_the_page(
    browser: Browser, address: str, tmp_path: Path
) -> None:
    with open_tab(browser, address) as tab:
        tab.emulate(width=300, height=200, colour_scheme="dark")
        tab.screenshot(tmp_path / "page.png")
        assert (tmp_path / "page.png").read_bytes()[16:24] == bytes((0, 0, 1, 44, 0, 0, 0, 200))
        assert tab.evaluate("matchMedia('(prefers-color-scheme: dark)').matches")
        before = tab.heap_mb()
        tab.evaluate("window.kept = Array.from({length: 1e6}, (_, i) => ({i})); undefined")
        assert tab.heap_mb() > before + 10.0


def test_browser_when_killed_leaves_no_process(executable: str) -> None:
    with start_browser(executable) as running:
        assert running.version.startswith("Chrome/")
        group = running.process.pid
        running.kill()
        running.process.wait(10.0)
    assert not any(_is_running_in(path, group) for path in Path("/proc").glob("[0-9]*/stat"))


def _is_running_in(path: Path, group: int) -> bool:
    """Whether a process of /proc runs in a group; zombies wait for their parent only."""
    try:
        fields = path.read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:
        return False
    return int(fields[2]) == group and fields[0] != "Z"
