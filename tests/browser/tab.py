"""One tab of the browser: navigation, scripts, input, screenshots, network and console logs."""

from __future__ import annotations

import base64
import json
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from browser.chromium import Browser
from browser.devtools import CALL_LIMIT_S, DevToolsError, Message, wait_until

# Every function here is called by the tests or measures a page from outside of its modules.
INSTRUMENTS = Path(__file__).with_name("instruments.js")
_LOAD_LIMIT_S = 20.0
# Virtual key codes and characters of the named keys; letters have their own.
_KEYS = {
    "Tab": (9, ""),
    "Enter": (13, "\r"),
    "Escape": (27, ""),
    " ": (32, " "),
    "End": (35, ""),
    "Home": (36, ""),
    "ArrowLeft": (37, ""),
    "ArrowUp": (38, ""),
    "ArrowRight": (39, ""),
    "ArrowDown": (40, ""),
}
_CODES = {" ": "Space"}


@dataclass(slots=True)
class TabLog:
    """Requests and console messages of a tab since its last navigation by a test."""

    urls: list[str] = field(default_factory=list)
    """Address of every request, WebSockets too."""
    messages: list[str] = field(default_factory=list)
    """Errors and warnings of the console, exceptions, and messages of the browser about a page."""
    sent: list[tuple[float, str]] = field(default_factory=list)
    """Monotonic time and text of every WebSocket message that the page sent."""


class Tab:
    """A tab; all waits have limits."""

    def __init__(self, browser: Browser, target: str) -> None:
        self.target = target
        self.log = TabLog()
        self._devtools = browser.devtools
        self._paths: dict[str, str] = {}
        self._lock = threading.Lock()
        attached = self._devtools.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = str(attached["sessionId"])
        self._devtools.set_handler(self._session, self._record)
        for domain in ("Page", "Runtime", "Network", "Log", "Performance"):
            self.call(f"{domain}.enable")
        self.call(
            "Page.addScriptToEvaluateOnNewDocument", source=INSTRUMENTS.read_text(encoding="utf-8")
        )

    def call(self, method: str, *, limit_s: float = CALL_LIMIT_S, **params: object) -> Message:
        """Call a DevTools method of this tab."""
        return self._devtools.call(method, session=self._session, limit_s=limit_s, **params)

    # Pages and scripts

    def open(self, url: str) -> None:
        """Navigate, and wait for the load event."""
        self.log = TabLog()
        result = self.call("Page.navigate", url=url)
        assert "errorText" not in result, f"{url}: {result['errorText']}"
        self.wait_for("document.readyState === 'complete'", "load event", _LOAD_LIMIT_S)

    def evaluate(self, expression: str, *, limit_s: float = CALL_LIMIT_S) -> Any:
        """Value of a JavaScript expression, of a promise its result.

        Raises:
            DevToolsError: The script threw an exception.
        """
        result = self.call(
            "Runtime.evaluate",
            limit_s=limit_s,
            expression=expression,
            awaitPromise=True,
            returnByValue=True,
        )
        if "exceptionDetails" in result:
            details = result["exceptionDetails"]
            thrown = details.get("exception", {}).get("description") or details["text"]
            raise DevToolsError(f"{expression[:200]}: {thrown}")
        return result["result"].get("value")

    def invoke(self, function: str, *arguments: object, limit_s: float = CALL_LIMIT_S) -> Any:
        """Result of a JavaScript function for arguments that JSON can hold."""
        values = ", ".join(map(json.dumps, arguments))
        return self.evaluate(f"({function})({values})", limit_s=limit_s)

    def wait_for(self, expression: str, event: str, limit_s: float) -> Any:
        """Poll an expression of the page until its value is true; the value."""
        try:
            return wait_until(lambda: self.evaluate(expression), event, limit_s)
        except DevToolsError as error:
            notice = self.evaluate("document.getElementById('notice')?.textContent")
            raise DevToolsError(f"{error}; {notice=}, console: {self.log.messages}") from None

    # Input

    def click(self, selector: str) -> None:
        """Scroll an element into view, and click its centre by mouse."""
        x, y = self.centre_of(selector)
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.mouse(kind, x, y)

    def centre_of(self, selector: str) -> tuple[float, float]:
        """Centre of an element in the viewport, after scrolling to it."""
        rect = self.invoke("instruments.scrollTo", selector)
        assert rect, f"no visible element matches {selector}"
        return rect[0], rect[1]

    def mouse(self, kind: str, x: float, y: float, *, delta_y: float = 0.0) -> None:
        """Send a mouse event: mouseMoved, mousePressed, mouseReleased or mouseWheel."""
        parameters: Message = {"type": kind, "x": x, "y": y}
        if kind == "mouseWheel":
            parameters |= {"deltaX": 0, "deltaY": delta_y}
        elif kind != "mouseMoved":
            parameters |= {"button": "left", "clickCount": 1}
        else:
            parameters |= {"buttons": 0}
        self.call("Input.dispatchMouseEvent", **parameters)

    def drag(self, path: Sequence[tuple[float, float]]) -> None:
        """Press the mouse at the first point, move through all, release at the last."""
        self.mouse("mousePressed", *path[0])
        for x, y in path[1:]:
            self.call(
                "Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y, button="left", buttons=1
            )
        self.mouse("mouseReleased", *path[-1])

    def touch(self, kind: str, *points: tuple[float, float]) -> None:
        """Send a touch event: touchStart, touchMove or touchEnd (without points)."""
        self.call(
            "Input.dispatchTouchEvent",
            type=kind,
            touchPoints=[{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)],
        )

    def key_down(self, key: str, *, shift: bool = False) -> None:
        """Press a key and hold it."""
        self._key("keyDown", key, shift=shift)

    def key_up(self, key: str) -> None:
        """Release a key."""
        self._key("keyUp", key)

    def press(self, key: str, *, shift: bool = False) -> None:
        """Press a key and release it."""
        self.key_down(key, shift=shift)
        self.key_up(key)

    def _key(self, kind: str, key: str, *, shift: bool = False) -> None:
        code, text = _KEYS.get(key, (ord(key[0].upper()), key))
        name = _CODES.get(key, f"Key{key.upper()}" if len(key) == 1 else key)
        parameters: Message = {
            "type": kind,
            "key": key,
            "code": name,
            "windowsVirtualKeyCode": code,
            "modifiers": 8 if shift else 0,
        }
        if kind == "keyDown" and text:
            parameters["text"] = text
        self.call("Input.dispatchKeyEvent", **parameters)

    # The tab and its window

    def activate(self) -> None:
        """Show this tab, with the focus; another tab of the window becomes hidden."""
        self._devtools.call("Target.activateTarget", targetId=self.target)

    def minimize(self, is_minimized: bool) -> None:
        """Minimize the window of this tab, which hides the tab, or show it again."""
        found = self._devtools.call("Browser.getWindowForTarget", targetId=self.target)
        self._devtools.call(
            "Browser.setWindowBounds",
            windowId=found["windowId"],
            bounds={"windowState": "minimized" if is_minimized else "normal"},
        )

    def close(self) -> None:
        """Close the tab, as its user does."""
        self._devtools.call("Target.closeTarget", targetId=self.target)
        self._devtools.remove_handler(self._session)

    def emulate(
        self, *, width: int, height: int, is_phone: bool = False, colour_scheme: str = "light"
    ) -> None:
        """Set viewport, touch input and the preferred colour scheme."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=is_phone,
        )
        self.call("Emulation.setTouchEmulationEnabled", enabled=is_phone)
        self.call("Emulation.setScrollbarsHidden", hidden=True)
        features = [{"name": "prefers-color-scheme", "value": colour_scheme}]
        self.call("Emulation.setEmulatedMedia", features=features)

    def screenshot(self, path: Path) -> None:
        """Write the viewport as a PNG file."""
        data = self.call("Page.captureScreenshot", format="png", limit_s=2 * CALL_LIMIT_S)["data"]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(base64.b64decode(data))

    def heap_mb(self) -> float:
        """Size of the live JavaScript objects, after a collection of garbage."""
        self.call("HeapProfiler.collectGarbage", limit_s=2 * CALL_LIMIT_S)
        return float(self.call("Runtime.getHeapUsage")["usedSize"]) / 2**20

    # Events

    def _record(self, method: str, params: Message) -> None:
        """Record an event; in the thread of the connection."""
        log = self.log
        if method == "Network.requestWillBeSent":
            log.urls.append(params["request"]["url"])
        elif method == "Network.webSocketCreated":
            log.urls.append(params["url"])
        elif method == "Network.webSocketFrameSent":
            log.sent.append((time.monotonic(), params["response"]["payloadData"]))
        elif message := _console_message(method, params):
            log.messages.append(message)


def _console_message(method: str, params: Message) -> str:
    """Text of an error or a warning; empty for other events."""
    if method == "Runtime.exceptionThrown":
        details = params["exceptionDetails"]
        thrown = details.get("exception", {}).get("description", "")
        return f"exception: {details['text']} {thrown}"
    if method == "Runtime.consoleAPICalled" and params["type"] in ("error", "warning", "assert"):
        values = (str(a.get("value", a.get("description", ""))) for a in params["args"])
        return f"{params['type']}: {' '.join(values)}"
    if method == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
        entry = params["entry"]
        return f"{entry['level']}: {entry['text']} {entry.get('url', '')}"
    return ""


@contextmanager
def open_tab(
    browser: Browser, url: str = "about:blank", *, new_window: bool = False
) -> Iterator[Tab]:
    """Open a tab for the length of a block.

    Args:
        browser: The browser.
        url: Address to open.
        new_window: Whether the tab gets a window of its own: tabs of one window hide each other.
    """
    created = browser.devtools.call("Target.createTarget", url="about:blank", newWindow=new_window)
    tab = Tab(browser, str(created["targetId"]))
    try:
        tab.activate()
        if url != "about:blank":
            tab.open(url)
        yield tab
    finally:
        if browser.process.poll() is None and not _is_closed(tab):
            tab.close()


def _is_closed(tab: Tab) -> bool:
    try:
        tab.call("Runtime.evaluate", expression="1", limit_s=5.0)
    except DevToolsError:
        return True
    return False
