"""Driving by keys: the delay to the wheels, and the stop when the driver is gone."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from statistics import median

import pytest

from browser.chromium import Browser, start_browser
from browser.devtools import pause, wait_until
from browser.live_server import LiveServer
from browser.measured_requirements import MeasuredRequirements
from browser.tab import Tab, open_tab

ROBOT = "Driven"
_NUM_KEYS = 20
_LIMIT_S = 5.0


def _speed(live: LiveServer) -> float:
    """Sum of the magnitudes of both commanded wheel speeds."""
    robot = live.probe.get_robot(ROBOT)
    assert robot is not None, f"{ROBOT} is not in the world"
    return abs(robot.wheel_speeds_rad_s[0]) + abs(robot.wheel_speeds_rad_s[1])


def _wait_for_motion(live: LiveServer) -> None:
    wait_until(lambda: _speed(live) > 0.0, "wheel speed", _LIMIT_S, poll_s=0.0)


def _time_to_stop(live: LiveServer, begin_s: float) -> float:
    """Seconds from a moment until both wheel speeds are 0."""
    wait_until(lambda: _speed(live) == 0.0, "stop", _LIMIT_S, poll_s=0.0)
    return time.monotonic() - begin_s


@contextmanager
def _share_robot(live: LiveServer) -> Iterator[None]:
    """A robot of the probe that pages may drive: it stays when a page ends."""
    live.probe.spawn(ROBOT, -1.0, 1.0)
    live.probe.share_control(True)
    try:
        yield
    finally:
        live.probe.reset()


@contextmanager
def _open_driver(browser: Browser, live: LiveServer, *, new_window: bool = True) -> Iterator[Tab]:
    """A tab that has selected the shared robot and has the focus."""
    with open_tab(browser, live.url, new_window=new_window) as tab:
        tab.wait_for("instruments.frames.length > 0", "picture", 10.0)
        select_robot(tab, ROBOT)
        status = "document.querySelector('.drive-status').textContent"
        tab.wait_for(f"/^Ready.*{ROBOT}/.test({status})", "readiness to drive", 5.0)
        yield tab


def select_robot(tab: Tab, name: str) -> None:
    """Select a robot in the page."""
    tab.invoke("(name) => window.catoptra.context.select(name, '')", name)
    tab.wait_for(f"window.catoptra.context.selected.robot === {name!r}", "selection", 5.0)


def test_wheels_when_a_key_is_pressed_turn_soon(
    browser: Browser, live: LiveServer, requirements: MeasuredRequirements
) -> None:
    times_ms = []
    with _share_robot(live), _open_driver(browser, live) as tab:
        for _ in range(_NUM_KEYS):
            begin_s = time.monotonic()
            tab.key_down("w")
            _wait_for_motion(live)
            times_ms.append(1000.0 * (time.monotonic() - begin_s))
            tab.key_up("w")
            _time_to_stop(live, begin_s)
            # A person's pace: the server limits what one page sends.
            pause(0.1)
    requirements.check(
        "key pressed to wheel speed at most 60 ms, median of 20",
        f"{median(times_ms):.0f} ms (largest {max(times_ms):.0f})",
        is_met=median(times_ms) <= 60.0,
    )


def _hide(tab: Tab, _: Browser) -> None:
    tab.minimize(True)


def _close(tab: Tab, _: Browser) -> None:
    tab.close()


def _lose_socket(tab: Tab, _: Browser) -> None:
    tab.evaluate("instruments.sockets.forEach((socket) => socket.close()); undefined")


def _kill(_: Tab, browser: Browser) -> None:
    os.killpg(browser.process.pid, signal.SIGKILL)


def _suspend(_: Tab, browser: Browser) -> None:
    os.killpg(browser.process.pid, signal.SIGSTOP)


@pytest.mark.parametrize(
    ("event", "end"),
    [
        ("hidden tab", _hide),
        ("closed tab", _close),
        ("closed sockets", _lose_socket),
        ("silent connection (stopped browser)", _suspend),
        ("killed browser", _kill),
    ],
)
def test_robot_when_its_driver_is_gone_stops(
    executable: str,
    live: LiveServer,
    requirements: MeasuredRequirements,
    event: str,
    end: Callable[[Tab, Browser], None],
) -> None:
    with _share_robot(live), start_browser(executable) as own, _open_driver(own, live) as tab:
        tab.key_down("w")
        _wait_for_motion(live)
        # The limit begins before the event: its own duration counts.
        begin_s = time.monotonic()
        end(tab, own)
        time_s = _time_to_stop(live, begin_s)
        requirements.check(
            f"dead-man stop within 300 ms: {event}",
            f"{1000.0 * time_s:.0f} ms",
            is_met=time_s <= 0.3,
        )
        # A page that is still there does not drive on by itself.
        watched_s = time.monotonic() + 0.7
        wait_until(
            lambda: _speed(live) > 0.0 or time.monotonic() > watched_s, "end", 2.0, poll_s=0.01
        )
        assert _speed(live) == 0.0
        # At once: a stopped browser answers nothing.
        own.kill()


def test_robot_when_the_key_is_released_stops(browser: Browser, live: LiveServer) -> None:
    with _share_robot(live), _open_driver(browser, live) as tab:
        tab.key_down("w")
        _wait_for_motion(live)
        begin_s = time.monotonic()
        tab.key_up("w")
        assert _time_to_stop(live, begin_s) < 0.3
