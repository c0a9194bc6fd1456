"""Five states of the page as pictures, for people to look at and for the documents."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from browser.chromium import Browser
from browser.devtools import pause
from browser.live_server import OwnedServer, start_live_server
from browser.stream_probe import connect_probe
from browser.tab import Tab, open_tab
from helpers.configs import ROBOTS, WORLDS

_LABORATORY = WORLDS / "laboratory.ini"
_MAX_BYTES = 300_000
_LIMIT_S = 30.0
_SETTLED_S = 1.5


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OwnedServer]:
    """A server with a robot that has driven an arc and believes to be beside its true pose."""
    folder = tmp_path_factory.mktemp("driven")
    with (
        start_live_server(folder, ROBOTS / "p2at_omni_live.ini", world=_LABORATORY) as live,
        connect_probe(live.server.stream_port) as owner,
    ):
        owner.spawn("Explorer", -1.2, -0.4)
        yield OwnedServer(live, owner)


def _publish_belief(owner_of: OwnedServer) -> None:
    """A note as a localizer publishes it: a pose near the true one, and what it detected."""
    robot = owner_of.live.probe.get_robot("Explorer")
    assert robot is not None
    x, y, _ = robot.world_from_robot.position_m
    rotation = robot.world_from_robot.rotation
    yaw = math.atan2(rotation[3], rotation[0])
    note = {
        "pose": [x + 0.06, y - 0.04, yaw + 0.03],
        "covariance": [0.01, 0.003, 0.0, 0.003, 0.006, 0.0, 0.0, 0.0, 0.002],
        "detections": [
            {"landmark": "yellow_goal", "bearing_rad": 0.2, "range_m": 2.5, "accepted": True},
            {"landmark": "cyan_over_magenta", "bearing_rad": -2, "range_m": 1.4, "accepted": False},
        ],
    }
    owner_of.owner.publish("ekf", json.dumps(note))


def _save(tab: Tab, path: Path) -> None:
    """Save the viewport and check that the picture is one."""
    pause(_SETTLED_S)
    tab.screenshot(path)
    image = cv2.imread(str(path))
    assert image is not None
    assert image.std() > 10.0, f"{path.name} shows nothing"
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 1000, f"{path.name} shows no pictures"
    # 256 colours that cover all there are: a median cut would lose small marks in rare colours.
    method = Image.Quantize.MAXCOVERAGE
    with Image.open(path) as picture:
        reduced = picture.convert("RGB").quantize(256, method, kmeans=2, dither=Image.Dither.NONE)
    reduced.save(path, optimize=True)
    assert path.stat().st_size < _MAX_BYTES, f"{path.name} has {path.stat().st_size} bytes"
    assert tab.log.messages == []


@pytest.mark.parametrize("colour_scheme", ["light", "dark"])
def test_overview(browser: Browser, driven: OwnedServer, output: Path, colour_scheme: str) -> None:
    with open_tab(browser, new_window=True) as tab:
        tab.emulate(width=1280, height=900, colour_scheme=colour_scheme)
        tab.open(driven.live.url)
        tab.wait_for("instruments.frames.length >= 5", "5 pictures", _LIMIT_S)
        driven.owner.drive(2.0, 1.5)
        pause(3.0)
        driven.owner.drive(0.0, 0.0)
        _publish_belief(driven)
        tab.wait_for("catoptra.context.landmarks.some((l) => l.status === 'detected')", "note", 5.0)
        _save(tab, output / f"live-{colour_scheme}.png")


def test_phone(browser: Browser, driven: OwnedServer, output: Path) -> None:
    with open_tab(browser, new_window=True) as tab:
        tab.emulate(width=390, height=844, is_phone=True)
        tab.open(driven.live.url)
        tab.wait_for("instruments.frames.length >= 5", "5 pictures", _LIMIT_S)
        widths = tab.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        assert widths[0] <= widths[1], "nothing lies beside the screen"
        _save(tab, output / "live-phone.png")


def _open(tab: Tab, url: str) -> None:
    """Open the page, with pictures."""
    tab.emulate(width=1280, height=900)
    tab.open(url)
    tab.wait_for("instruments.frames.length >= 3", "3 pictures", _LIMIT_S)


def test_accuracy(browser: Browser, driven: OwnedServer, output: Path) -> None:
    with open_tab(browser, new_window=True) as tab:
        _open(tab, driven.live.url)
        tab.invoke(
            """() => {
              const slider = document.querySelector("#cost-slider");
              slider.value = slider.max - 1;
              slider.dispatchEvent(new Event("input"));
              document.querySelector("#body-cost button").click();
            }"""
        )
        shown = "document.querySelector('#panel-omni .difference').checkVisibility()"
        tab.wait_for(shown, "difference picture", _LIMIT_S)
        pause(2.0)
        _save(tab, output / "live-accuracy.png")


def test_effects(browser: Browser, tmp_path: Path, output: Path) -> None:
    robot = ROBOTS / "p2at_omni_real.ini"
    with (
        start_live_server(tmp_path, robot, world=_LABORATORY) as live,
        connect_probe(live.server.stream_port) as owner,
        open_tab(browser, new_window=True) as tab,
    ):
        owner.spawn("Explorer", 0.8, -0.6)
        _open(tab, live.url)
        button = "#panel-effects button[aria-label^='Veiling Glare']"
        tab.wait_for(f'document.querySelector("{button}") !== null', "list of effects", _LIMIT_S)
        for _ in range(2):  # as set, auto, always
            tab.click(button)
        enabled = "effects.find(({ name }) => name === 'VeilingGlare').enabled"
        tab.wait_for(f"catoptra.context.frame.header.{enabled}", "forced effect", _LIMIT_S)
        tab.evaluate("document.querySelector('#body-effects').scrollTop = 0; scrollTo(0, 0)")
        _save(tab, output / "live-effects.png")
