"""Every panel of the page is used as a person does, and every script of the page runs."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from browser.chromium import Browser
from browser.devtools import wait_until
from browser.live_server import CAMERA, LiveServer, OwnedServer
from browser.measured_requirements import MeasuredRequirements
from browser.static_files import list_scripts
from browser.tab import Tab, open_tab

# The test of each panel of panels.js.
PANEL_TESTS = {
    "omni": "test_omni_zooms_and_moves_the_cursor",
    "status": "test_status_shows_robot_rate_bound_cost_and_age",
    "drive": "test_drive_turns_the_wheels_by_stick_gamepad_and_keys",
    "panorama": "test_panorama_turns_the_perspective_view",
    "map": "test_map_draws_layers_and_notes",
    "perspective": "test_perspective_turns_by_dragging",
    "robot": "test_robot_is_spawned_shared_and_removed",
    "cost": "test_accuracy_of_few_polygons_shows_a_difference",
    "accuracy": "test_accuracy_target_shows_its_plan",
    "effects": "test_effects_when_forced_change_all_pictures",
    "labels": "test_labels_show_range_and_objects",
    "plots": "test_plots_add_and_remove_series",
    "scans": "test_scans_show_the_nearest_echo",
}
# Least fraction of the functions of a script that the tests of this module call.
_MIN_COVERED = 0.5
# Of each wait; on a machine with ten times as much to do a picture takes seconds.
_LIMIT_S = 30.0
# Scripts of a worker, whose coverage the page's profiler does not have. The pictures that they draw
# are compared in test_unwarping.
_IN_WORKER = frozenset({"unwarp_worker.js", "unwarp_renderer.js", "shaders.js"})
_PIXELS_PX = 360
_NOTE = {
    "pose": [0.7, -0.5, 0.4],
    "covariance": [0.04, 0.01, 0.0, 0.01, 0.02, 0.0, 0.0, 0.0, 0.01],
    "detections": [
        {"landmark": "yellow_goal", "bearing_rad": 0.1, "range_m": 1.5, "accepted": True},
        {"landmark": "cyan_goal", "bearing_rad": 3.0, "range_m": None, "accepted": False},
    ],
    "text": "innovation 0.03 m",
}


@pytest.fixture(scope="module")
def page(browser: Browser, full_live: OwnedServer) -> Iterator[Tab]:
    """The page of a robot with everything, all panels in view, with coverage of its scripts."""
    with open_tab(browser, new_window=True) as tab:
        tab.emulate(width=1400, height=3200)
        tab.call("Profiler.enable")
        tab.call("Profiler.startPreciseCoverage", callCount=True, detailed=False)
        tab.open(full_live.live.url)
        tab.wait_for("instruments.frames.length >= 5", "5 pictures", 4 * _LIMIT_S)
        yield tab


def _text(tab: Tab, panel: str) -> str:
    return str(tab.evaluate(f"document.querySelector('#panel-{panel} .body').innerText"))


def _wait_for_text(tab: Tab, panel: str, pattern: str, limit_s: float = _LIMIT_S) -> None:
    body = f"document.querySelector('#panel-{panel} .body').innerText"
    tab.wait_for(f"new RegExp({json.dumps(pattern)}).test({body})", f"{pattern!r}", limit_s)


def _image(tab: Tab, selector: str) -> str:
    """Contents of a canvas, to be compared."""
    return str(tab.invoke("(s) => document.querySelector(s).toDataURL()", selector))


def _wait_for_change(tab: Tab, selector: str, before: str) -> None:
    wait_until(lambda: _image(tab, selector) != before, f"change of {selector}", _LIMIT_S)


def _focus(tab: Tab, selector: str) -> None:
    tab.invoke("(s) => document.querySelector(s).focus()", selector)


def _choose(tab: Tab, selector: str, value: str) -> None:
    """Choose an option once it is there, or fill in a field, as the keyboard of a person does."""
    choose = """(selector, value) => {
      const list = document.querySelector(selector);
      if (list.options && ![...list.options].some((one) => one.value === value)) return false;
      list.focus();
      list.value = value;
      for (const name of ["input", "change"]) {
        list.dispatchEvent(new Event(name, { bubbles: true }));
      }
      return true;
    }"""
    event = f"option {value!r} of {selector}"
    wait_until(lambda: tab.invoke(choose, selector, value), event, _LIMIT_S)


def _click_button(tab: Tab, panel: str, text: str) -> None:
    """Click the button of a panel with a text or a name once it is there."""
    event = f"click of {text!r} in panel {panel}"
    wait_until(lambda: _reach_button(tab, panel, text), event, _LIMIT_S)


def _reach_button(tab: Tab, panel: str, text: str) -> bool:
    """Click where a button is; whether the button was still there."""
    # Its place at once: the page replaces rows of lists, by buttons in the same place.
    centre = tab.invoke(
        """(panel, text) => {
          const isWanted = (button) => Boolean(button?.closest(`#panel-${panel}`))
            && button.checkVisibility()
            && Boolean(button.textContent.trim() === text || button.ariaLabel?.startsWith(text));
          const found = [...document.querySelectorAll("button")].find(isWanted);
          window.isClicked = false;
          const note = (event) => { window.isClicked = isWanted(event.target.closest("button")); };
          window.addEventListener("click", note, { capture: true, once: true });
          found?.setAttribute("data-clicked", panel);
          const centre = found && instruments.scrollTo(`[data-clicked="${panel}"]`);
          found?.removeAttribute("data-clicked");
          return centre;
        }""",
        panel,
        text,
    )
    for kind in ("mouseMoved", "mousePressed", "mouseReleased") if centre else ():
        tab.mouse(kind, *centre)
    return bool(tab.evaluate("window.isClicked"))


def _cursor(tab: Tab) -> list[float]:
    pixel = tab.evaluate("catoptra.context.cursor.pixel")
    assert pixel, "there is a cursor"
    return [float(value) for value in pixel]


def _hover(tab: Tab, selector: str, dx: float = 0.0, dy: float = 0.0) -> None:
    x, y = tab.centre_of(selector)
    tab.mouse("mouseMoved", x + dx, y + dy)


def test_status_shows_robot_rate_bound_cost_and_age(page: Tab) -> None:
    facts = r"Robot Full[\s\S]*[1-9]\d* pictures/s[\s\S]*px[\s\S]*\d ms a picture[\s\S]*old"
    _wait_for_text(page, "status", facts, 4 * _LIMIT_S)
    age = page.evaluate("document.getElementById('status-age').textContent")
    page.wait_for(f"document.getElementById('status-age').textContent !== {age!r}", "age", _LIMIT_S)


def test_omni_zooms_and_moves_the_cursor(page: Tab) -> None:
    overlay = "#panel-omni .overlay"
    _hover(page, overlay)
    pixel = "catoptra.context.cursor.pixel"
    is_middle = f"{pixel}?.every((value) => Math.abs(value - {_PIXELS_PX / 2}) < 3)"
    page.wait_for(is_middle, "cursor in the middle", _LIMIT_S)
    middle = _cursor(page)
    _hover(page, overlay, dx=60.0)
    page.wait_for(f"{pixel}[0] > {middle[0] + 10.0}", "cursor at the right", _LIMIT_S)
    wide_px = _cursor(page)[0] - middle[0]
    x, y = page.centre_of(overlay)
    page.mouse("mouseWheel", x, y, delta_y=-600.0)

    def is_zoomed() -> bool:
        _hover(page, overlay, dx=59.0)
        _hover(page, overlay, dx=60.0)
        return 0.0 < _cursor(page)[0] - middle[0] < 0.7 * wide_px

    wait_until(is_zoomed, "zoom by the wheel", _LIMIT_S)
    _click_button(page, "omni", "Fit")
    page.click(overlay)
    card = "document.querySelector('#cursor-card').innerText"
    page.wait_for(f"{card}.includes('Held')", "held cursor", _LIMIT_S)
    before = _cursor(page)
    page.press("ArrowRight")
    page.press("ArrowRight", shift=True)
    # The first key moves the cursor to the centre of a pixel.
    page.wait_for(f"Math.abs({pixel}[0] - {before[0] + 11.0}) < 0.6", "step of 11 px", _LIMIT_S)
    page.press("Escape")
    page.wait_for(f"{pixel} === null", "end of the cursor", _LIMIT_S)


def test_cursor_shows_what_the_camera_sees(page: Tab) -> None:
    # A quarter of the view below the middle: the floor behind the robot.
    _hover(page, "#panel-omni .overlay", dy=100.0)
    card = "document.querySelector('#cursor-card').innerText"
    shown = r"object\s+\w+\s+range\s+\d+\.\d+ m[\s\S]*°[\s\S]*bound\s+\S+ px"
    page.wait_for(f"/{shown}/.test({card})", "what is under the cursor", _LIMIT_S)
    _hover(page, "#panel-plots")
    page.wait_for("catoptra.context.cursor.pixel === null", "end of the cursor", _LIMIT_S)
    assert not page.evaluate("document.querySelector('#cursor-card').checkVisibility()")


def test_panorama_turns_the_perspective_view(page: Tab) -> None:
    overlay = "#panel-panorama .overlay"
    x, y = page.centre_of(overlay)
    width = page.evaluate(f"document.querySelector('{overlay}').clientWidth")
    page.mouse("mouseMoved", x + width / 4, y)
    page.click(overlay)
    page.mouse("mouseMoved", x + width / 4, y)
    _focus(page, overlay)
    page.press("Escape")
    page.mouse("mouseMoved", x + width / 4 - 1, y)
    page.mouse("mouseMoved", x + width / 4, y)
    page.press("l")
    # A quarter of the width is a quarter of a turn to the right.
    quarter = "Math.abs(catoptra.context.window.yaw_rad - Math.PI / 2) < 0.03"
    page.wait_for(quarter, "quarter of a turn", _LIMIT_S)
    _click_button(page, "perspective", "Ahead")
    page.wait_for("catoptra.context.window.yaw_rad === 0", "view ahead", _LIMIT_S)


def test_perspective_turns_by_dragging(page: Tab) -> None:
    overlay = "#panel-perspective .overlay"
    before = _image(page, "#panel-perspective .picture")
    x, y = page.centre_of(overlay)
    page.drag([(x, y), (x - 30, y), (x - 80, y + 10)])
    page.wait_for("catoptra.context.window.yaw_rad > 0.1", "turn", _LIMIT_S)
    _wait_for_change(page, "#panel-perspective .picture", before)
    page.mouse("mouseWheel", x, y, delta_y=-300.0)
    page.wait_for("catoptra.context.window.fov_rad < 1.2", "zoom", _LIMIT_S)
    _focus(page, overlay)
    page.press("0")
    page.wait_for("catoptra.context.window.yaw_rad === 0", "view ahead", _LIMIT_S)


def test_map_draws_layers_and_notes(page: Tab, full_live: OwnedServer) -> None:
    canvas = "#panel-map canvas"
    before = _image(page, canvas)
    full_live.owner.publish("ekf", json.dumps(_NOTE))
    _wait_for_change(page, canvas, before)
    _wait_for_text(page, "robot", "innovation 0.03 m")
    statuses = "Object.fromEntries(catoptra.context.landmarks.map((l) => [l.name, l.status]))"
    page.wait_for(f"({statuses}).yellow_goal === 'detected'", "detected landmark", _LIMIT_S)
    assert page.evaluate(f"({statuses}).cyan_goal") == "rejected"
    page.click("#panel-map summary")
    for layer in ("filter", "landmark", "scan"):
        before = _image(page, canvas)
        page.click(f"#panel-map .layer.{layer} input")
        _wait_for_change(page, canvas, before)
        page.click(f"#panel-map .layer.{layer} input")
    before = _image(page, canvas)
    _click_button(page, "map", "Zoom in")
    _wait_for_change(page, canvas, before)
    _move_map(page, canvas)
    _click_button(page, "map", "Follow")
    _click_button(page, "map", "Fit")


def test_map_shows_the_plan_of_the_floor_which_is_requested_once(page: Tab) -> None:
    tiles = "document.querySelectorAll('#panel-map .layers i')"
    page.wait_for(f"{tiles}.length === 2", "legend of the plan", _LIMIT_S)
    colour = "(i) => getComputedStyle(i).backgroundColor.match(/\\d+/g).map(Number)"
    counts = (
        # By a copy, as below.
        f"""(() => {{
          const canvas = document.querySelector("#panel-map canvas");
          const {{ width, height }} = canvas;
          const pen = new OffscreenCanvas(width, height).getContext("2d");
          pen.drawImage(canvas, 0, 0);
          const {{ data }} = pen.getImageData(0, 0, width, height);
          const near = (rgb) => {{
            let count = 0;
            for (let i = 0; i < data.length; i += 4)
              count += rgb.every((value, k) => Math.abs(data[i + k] - value) < 40);
            return count / (data.length / 4);
          }};
          return [...{tiles}].map({colour}).map(near);
        }})()"""
    )

    def is_drawn() -> bool:
        free, obstacle = page.evaluate(counts)
        return 0.05 < free < 0.6 and 0.005 < obstacle < 0.2

    # Once its picture is decoded.
    wait_until(is_drawn, "plan on the map", _LIMIT_S)
    entries = (
        "performance.getEntriesByType('resource').filter((e) => e.name.includes('floor_plan'))"
    )
    assert page.evaluate(f"{entries}.length") == 1


def _move_map(tab: Tab, canvas: str) -> None:
    """Pan and zoom by mouse and keys."""
    x, y = tab.centre_of(canvas)
    moves: tuple[Callable[[], object], ...] = (
        lambda: tab.drag([(x, y), (x + 20, y + 10), (x + 40, y + 20)]),
        lambda: tab.mouse("mouseWheel", x, y, delta_y=-200.0),
        lambda: tab.press("ArrowLeft"),
        lambda: tab.press("-"),
    )
    for move in moves:
        before = _image(tab, canvas)
        _focus(tab, canvas)
        move()
        _wait_for_change(tab, canvas, before)


def test_scans_show_the_nearest_echo(page: Tab) -> None:
    canvas = "#panel-scans canvas"
    _wait_for_text(page, "scans", r"Nearest: \d+\.\d+ m")
    before = _image(page, canvas)
    page.click("#panel-scans .layer.sonar input")
    page.click("#panel-scans .layer.scan input")
    _wait_for_text(page, "scans", "No range sensor is shown")
    _wait_for_change(page, canvas, before)
    page.click("#panel-scans .layer.sonar input")
    page.click("#panel-scans .layer.scan input")


def test_plots_add_and_remove_series(page: Tab) -> None:
    _choose(page, "#panel-plots select", "F1 range")
    _wait_for_text(page, "plots", r"F1 range\s*\d")
    _hover(page, "#panel-plots canvas")
    plots = "document.querySelectorAll('#panel-plots canvas').length"
    page.wait_for(f"{plots} >= 2", "plot", _LIMIT_S)
    _click_button(page, "plots", "Remove F1 range")
    page.wait_for(
        "!document.querySelector('#panel-plots .chips').innerText.includes('F1')",
        "removal",
        _LIMIT_S,
    )


def test_robot_is_spawned_shared_and_removed(page: Tab, full_live: OwnedServer) -> None:
    probe = full_live.live.probe
    page.invoke("() => { document.querySelector('#panel-robot [name=name]').value = 'Mine'; }")
    _choose(page, "#panel-robot [name=start]", "CornerCyanLeft")
    _click_button(page, "robot", "Spawn")
    wait_until(lambda: probe.get_robot("Mine"), "robot of the page", _LIMIT_S)
    page.wait_for("catoptra.context.selected.robot === 'Mine'", "its selection", _LIMIT_S)
    page.click("#panel-robot input[type=checkbox]")
    wait_until(lambda: _shares(full_live.live, "Mine"), "shared control", _LIMIT_S)
    _click_button(page, "robot", f"Watch omni camera {CAMERA} of Full")
    page.wait_for("instruments.frames.at(-1).robot === 'Full'", "picture of another", _LIMIT_S)
    _click_button(page, "robot", "Remove Mine")
    wait_until(lambda: not probe.get_robot("Mine"), "removal", _LIMIT_S)
    # By keys: the panel moves while the controls of one's own robot disappear.
    _focus(page, "#panel-robot summary")
    page.press("Enter")
    _wait_for_text(page, "robot", "ECLeft")
    page.press("Enter")


def test_robot_is_spawned_where_the_map_is_pressed(page: Tab, full_live: OwnedServer) -> None:
    probe = full_live.live.probe
    page.invoke("() => { document.querySelector('#panel-robot [name=name]').value = 'Placed'; }")
    _choose(page, "#panel-robot [name=start]", "")
    _click_button(page, "robot", "Press on the map")
    x, y = page.centre_of("#panel-map canvas")
    # Dragged to the right: a heading of a quarter of a turn.
    page.drag([(x, y), (x + 20, y), (x + 50, y)])
    robot = wait_until(lambda: probe.get_robot("Placed"), "robot of the page", _LIMIT_S)
    assert robot is not None
    rotation = robot.world_from_robot.rotation
    assert math.atan2(rotation[3], rotation[0]) == pytest.approx(math.pi / 2, abs=0.05)
    # The server has the robot before the page knows that it is its own.
    page.wait_for("catoptra.context.selected.robot === 'Placed'", "its selection", _LIMIT_S)
    _click_button(page, "robot", "Remove Placed")
    wait_until(lambda: not probe.get_robot("Placed"), "removal", _LIMIT_S)


def _shares(live: LiveServer, name: str) -> bool:
    robot = live.probe.get_robot(name)
    return robot is not None and robot.shares_control


def _speeds(live: LiveServer, name: str) -> tuple[float, float]:
    robot = live.probe.get_robot(name)
    return (0.0, 0.0) if robot is None else robot.wheel_speeds_rad_s


def test_drive_turns_the_wheels_by_stick_gamepad_and_keys(
    page: Tab, full_live: OwnedServer
) -> None:
    live = full_live.live
    full_live.owner.share_control(True)
    # By name: the page may still be ready for a robot that was removed a moment ago, and a stick
    # that is held when the robot changes drives nothing until it is moved again.
    _wait_for_text(page, "drive", "Ready to drive Full")
    page.activate()
    _drive_by_stick(page, live)
    _drive_by_gamepad(page, live)
    for key, signs in (("a", (-1, 1)), ("ArrowDown", (-1, -1))):
        page.key_down(key)
        wait_until(partial(_has_signs, live, signs), f"motion by {key}", _LIMIT_S)
        page.key_up(key)
        _wait_for_stop(live)
    page.key_down("w")
    wait_until(lambda: _has_signs(live, (1, 1)), "motion", _LIMIT_S)
    page.press(" ")
    _wait_for_stop(live)
    page.key_up("w")
    full_live.owner.share_control(False)
    _wait_for_text(page, "drive", "owner does not share it")


def _has_signs(live: LiveServer, signs: tuple[int, int]) -> bool:
    speeds = _speeds(live, "Full")
    return all(np.sign(speed) == sign for speed, sign in zip(speeds, signs, strict=True))


def _wait_for_stop(live: LiveServer) -> None:
    wait_until(lambda: _speeds(live, "Full") == (0.0, 0.0), "stop", _LIMIT_S)


def _drive_by_stick(tab: Tab, live: LiveServer) -> None:
    x, y = tab.centre_of(".stick")
    tab.mouse("mousePressed", x, y)
    tab.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y - 40, button="left", buttons=1)
    wait_until(lambda: _has_signs(live, (1, 1)), "motion by the stick", _LIMIT_S)
    tab.mouse("mouseReleased", x, y - 40)
    _wait_for_stop(live)


def _drive_by_gamepad(tab: Tab, live: LiveServer) -> None:
    """A gamepad by the interface that pages read: DevTools has none."""
    tab.evaluate(
        """(() => {
          window.pad = { connected: true, id: "Pad", axes: [0, -1], buttons: [] };
          navigator.getGamepads = () => [window.pad];
          const event = new Event("gamepadconnected");
          event.gamepad = window.pad;
          window.dispatchEvent(event);
        })()"""
    )
    wait_until(lambda: _has_signs(live, (1, 1)), "motion by the gamepad", _LIMIT_S)
    tab.evaluate("window.pad.axes = [0.05, 0.05]; undefined")
    _wait_for_stop(live)
    tab.evaluate("window.pad.connected = false; undefined")


def _difference(tab: Tab) -> int:
    """Largest difference that lies over the picture, in grey levels."""
    text = "document.querySelector('#panel-omni .difference').innerText"
    found = f"({text}.match(/Error: at most (\\d+)/) ?? [])[1]"
    return int(tab.wait_for(found, "difference", 2 * _LIMIT_S))


def test_labels_show_range_and_objects(page: Tab) -> None:
    canvas = "document.querySelector('#panel-labels canvas')"
    colours = (
        # By a copy: Chromium warns of a canvas of the page that is read often.
        f"(() => {{ const c = {canvas}; const copy = new OffscreenCanvas(c.width, c.height);"
        " const pen = copy.getContext('2d', { willReadFrequently: true });"
        " pen.drawImage(c, 0, 0); return new Set(new Uint32Array("
        "pen.getImageData(0, 0, c.width, c.height).data.buffer)).size; })()"
    )
    for channel, least in (("range", 50), ("ids", 5), ("classes", 3), ("normal", 3)):
        _choose(page, "#labels-channel", channel)
        page.wait_for(f"{colours} >= {least} && {canvas}.width > 100", channel, _LIMIT_S)
    _choose(page, "#labels-channel", "ids")
    _wait_for_text(page, "labels", r"Under the cursor: (no cursor|.+ of class .+|nothing)")


def test_accuracy_of_few_polygons_shows_a_difference(
    page: Tab, requirements: MeasuredRequirements
) -> None:
    last = page.evaluate("document.querySelector('#cost-slider').max")
    _choose(page, "#cost-slider", last)
    _wait_for_text(page, "cost", "Show the error")
    bound = "document.querySelector('#panel-cost output').innerText"
    page.wait_for(f"/^16 polygons: at most \\d+/.test({bound})", "bound of polygons", _LIMIT_S)
    _click_button(page, "cost", "Show the error")
    wait_until(lambda: _difference(page) > 30, "large difference", 4 * _LIMIT_S)
    coarse = _difference(page)
    colours = "new Set(new Uint32Array(pen.getImageData(0, 0, pen.canvas.width, 200).data.buffer))"
    canvas = "document.querySelector('#panel-omni .difference canvas')"
    page.wait_for(
        f"(() => {{ const pen = {canvas}.getContext('2d'); return {colours}.size > 8; }})()",
        "heat map",
        _LIMIT_S,
    )
    _choose(page, "#cost-slider", "1")
    wait_until(lambda: _difference(page) < coarse, "smaller difference", 4 * _LIMIT_S)
    requirements.check(
        "accuracy: 16 polygons differ from the exact surface, most polygons less",
        f"{coarse} and {_difference(page)} grey levels",
        is_met=coarse > _difference(page),
    )
    _click_button(page, "cost", "Show the error")
    _click_button(page, "cost", "Reset")
    page.wait_for(f"/^As the camera is set/.test({bound})", "the camera's settings", _LIMIT_S)


def test_accuracy_target_shows_its_plan(page: Tab) -> None:
    _choose(page, "#accuracy-tolerance", "2")
    # The server measures the cost of plans first.
    _wait_for_text(page, "accuracy", r"predicted\s+\S+ ms", 4 * _LIMIT_S)
    _choose(page, "#accuracy-samples", "1")
    _wait_for_text(page, "accuracy", r"1\^2 samples|1 sample", 4 * _LIMIT_S)
    _click_button(page, "cost", "Reset")


def test_effects_when_forced_change_all_pictures(
    page: Tab, requirements: MeasuredRequirements
) -> None:
    _wait_for_text(page, "effects", "Vignetting")
    # "as set" -> auto -> always -> never.
    for mode in ("as set", "auto", "always"):
        _click_button(page, "effects", f"Vignetting: {mode}")
    decision = "catoptra.context.frame.header.effects.find((e) => e.name === 'Vignetting').enabled"
    page.wait_for(f"!{decision}", "picture without the effect", 2 * _LIMIT_S)
    # From the picture by the camera's own settings, which has the effect.
    _click_button(page, "cost", "Show the error")
    difference = wait_until(lambda: _difference(page), "difference", 2 * _LIMIT_S)
    requirements.check(
        "effects panel: a forced effect shows its difference",
        f"Vignetting off: at most {difference} grey levels",
        is_met=difference > 0,
    )
    _click_button(page, "cost", "Show the error")
    _click_button(page, "cost", "Reset")
    page.wait_for(decision, "the camera's settings", _LIMIT_S)


# Positions of the names in a view, by the text that is written into its canvas.
_SPY_ON_NAMES = """(selector) => {
  const pen = document.querySelector(selector).getContext("2d");
  window.names = {};
  const { fillText } = pen;
  pen.fillText = (text, x, y) => {
    window.names[text] = [x, y];
    fillText.call(pen, text, x, y);
  };
}"""


def test_names_stay_on_the_picture_that_a_view_shows(page: Tab, full_live: OwnedServer) -> None:
    page.invoke(_SPY_ON_NAMES, "#panel-panorama .overlay")
    page.wait_for("Object.keys(names).includes('yellow_goal')", "names", _LIMIT_S)
    rotation = "catoptra.context.frame.header.world_from_robot.rotation"
    yaw = f"Math.atan2({rotation}[3], {rotation}[0])"
    before_yaw = page.evaluate(yaw)
    # The view is slow: it shows the picture that it has.
    page.evaluate("window.draw = catoptra.context.unwarper.draw; undefined")
    page.evaluate("catoptra.context.unwarper.draw = () => {}; undefined")
    shown = page.evaluate("names.yellow_goal")
    full_live.owner.drive(2.0, -2.0)
    page.wait_for(f"Math.abs({yaw} - {before_yaw}) > 0.5", "a turned robot", _LIMIT_S)
    full_live.owner.drive(0.0, 0.0)
    page.evaluate("window.names = {}; catoptra.context.emit('landmarks')")
    page.wait_for("names.yellow_goal", "names", _LIMIT_S)
    assert page.evaluate("names.yellow_goal") == pytest.approx(shown, abs=5.0)
    page.evaluate("catoptra.context.unwarper.draw = draw; undefined")
    moved = f"Math.abs(names.yellow_goal[0] - {shown[0]}) > 5"
    page.wait_for(moved, "names on the newest picture", _LIMIT_S)


def test_snapshot_downloads_pictures(browser: Browser, page: Tab) -> None:
    picture = _download(browser, page, "omni", "Save the picture (PNG)")
    assert picture.shape[:2] == (_PIXELS_PX, _PIXELS_PX)
    panorama = _download(browser, page, "panorama", "Save the panorama (PNG)")
    assert panorama.shape[1] == 2 * _PIXELS_PX


def _download(browser: Browser, tab: Tab, panel: str, button: str) -> npt.NDArray[np.uint8]:
    """Picture that a button saves."""
    before = set(browser.downloads.iterdir())
    _click_button(tab, panel, button)

    def find_file() -> list[Path]:
        return [p for p in browser.downloads.glob("*.png") if p not in before]

    (path,) = wait_until(find_file, "downloaded file", _LIMIT_S)
    assert path.name.startswith("Full_")
    image = cv2.imread(str(path))
    assert image is not None, f"{path.name} is no picture"
    assert image.std() > 10.0, f"{path.name} is empty"
    return np.asarray(image, np.uint8)


def test_scripts_of_the_page_all_run(page: Tab, requirements: MeasuredRequirements) -> None:
    covered = _covered_functions(page)
    fractions = {name: covered.get(name, 0.0) for name in list_scripts() if name not in _IN_WORKER}
    requested = {url.partition("/static/")[2] for url in page.log.urls}
    low = {name: round(value, 2) for name, value in fractions.items() if value < _MIN_COVERED}
    requirements.check(
        f"each script of the page runs, at least {100 * _MIN_COVERED:.0f} % of its functions",
        f"{len(fractions)} scripts, {100 * np.mean(list(fractions.values())):.0f} % of their "
        f"functions {low or ''}",
        is_met=len(fractions) > 10 and not low and set(fractions) <= requested,
    )
    assert page.log.messages == []


def _covered_functions(tab: Tab) -> dict[str, float]:
    """Fraction of the functions of each script that have been called."""
    result: list[dict[str, Any]] = tab.call("Profiler.takePreciseCoverage")["result"]
    counts: dict[str, list[bool]] = {}
    for script in result:
        name = script["url"].partition("/static/")[2]
        called = [bool(function["ranges"][0]["count"]) for function in script["functions"]]
        if name:
            # A script of an earlier load of the page counts too.
            known = counts.get(name, [False] * len(called))
            counts[name] = [a or b for a, b in zip(known, called, strict=False)] or called
    return {name: sum(called) / len(called) for name, called in counts.items() if called}


def test_panels_when_collapsed_stay_so(page: Tab) -> None:
    page.click("#panel-scans .toggle")
    canvas = "document.querySelector('#panel-scans canvas').checkVisibility()"
    page.wait_for(f"!{canvas}", "collapsed panel", _LIMIT_S)
    page.evaluate("window.isOld = true; location.reload()")
    expanded = "document.querySelector('#panel-scans .toggle')?.ariaExpanded"
    page.wait_for(f"!window.isOld && {expanded} === 'false'", "reload", 2 * _LIMIT_S)
    # The page moves while it loads.
    page.wait_for("instruments.frames.length >= 1", "picture", 2 * _LIMIT_S)
    page.click("#panel-scans .toggle")
    page.wait_for(f"{expanded} === 'true'", "expanded panel", _LIMIT_S)
