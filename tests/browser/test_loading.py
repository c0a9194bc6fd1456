"""Opening the page: its requests, its messages, and the time to its first picture."""

from __future__ import annotations

from statistics import median
from urllib.parse import urlsplit

from browser.chromium import Browser
from browser.live_server import LiveServer
from browser.measured_requirements import MeasuredRequirements
from browser.tab import Tab, open_tab

_NUM_OPENINGS = 5
_PICTURE_LIMIT_S = 10.0
# Longer than the start of every panel.
FIRST_FRAMES = "instruments.frames.length >= 20"


def _open_and_draw(tab: Tab, live: LiveServer) -> float:
    """Milliseconds from the start of the navigation to the first drawn picture."""
    tab.open(live.url)
    tab.wait_for("instruments.frames.length > 0", "picture", _PICTURE_LIMIT_S)
    return float(tab.evaluate("instruments.frames[0].shown_ms ?? instruments.frames[0].drawn_ms"))


def test_page_when_it_opens_has_no_foreign_requests_and_no_messages(
    browser: Browser, live: LiveServer, requirements: MeasuredRequirements
) -> None:
    with open_tab(browser, live.url) as tab:
        tab.wait_for(FIRST_FRAMES, "20 pictures", _PICTURE_LIMIT_S)
        own = urlsplit(live.url).netloc
        foreign = [url for url in tab.log.urls if urlsplit(url).netloc not in ("", own)]
        requirements.check(
            "no request to another host",
            f"{len(foreign)} of {len(tab.log.urls)} {foreign or ''}",
            is_met=len(tab.log.urls) > 3 and not foreign,
        )
        requirements.check(
            "no error and no warning in the console",
            f"{len(tab.log.messages)} {tab.log.messages or ''}",
            is_met=not tab.log.messages,
        )


def test_page_when_it_opens_draws_by_software(browser: Browser, live: LiveServer) -> None:
    renderer = """(() => {
      const gl = document.createElement("canvas").getContext("webgl2");
      return gl.getParameter(gl.getExtension("WEBGL_debug_renderer_info").UNMASKED_RENDERER_WEBGL);
    })()"""
    with open_tab(browser, live.url) as tab:
        assert "SwiftShader" in tab.evaluate(renderer)
        tab.wait_for("instruments.frames.length > 0", "picture", _PICTURE_LIMIT_S)
        assert tab.evaluate("instruments.frames[0].width_px") == 640


def test_page_when_it_opens_shows_a_picture_within_a_second(
    browser: Browser, live: LiveServer, requirements: MeasuredRequirements
) -> None:
    times_ms = []
    for _ in range(_NUM_OPENINGS):
        with open_tab(browser) as tab:
            times_ms.append(_open_and_draw(tab, live))
    requirements.check(
        "first picture of 640 px at most 1 s after opening, median of 5",
        f"{median(times_ms):.0f} ms (largest {max(times_ms):.0f})",
        is_met=median(times_ms) <= 1000.0,
    )


def test_page_when_there_is_no_robot_says_so(browser: Browser, empty_live: LiveServer) -> None:
    with open_tab(browser, empty_live.url) as tab:
        tab.wait_for("document.body.innerText.match(/no robot/i)", "text about no robot", 5.0)
        assert tab.log.messages == []
