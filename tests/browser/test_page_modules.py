"""Modules of the page that compute without drawing, in the browser, against values by hand."""

from __future__ import annotations

import json
from collections.abc import Iterator
from math import cos, pi, radians, sin
from typing import Any

import numpy as np
import pytest

from browser.chromium import Browser
from browser.live_server import LiveServer
from browser.tab import Tab, open_tab
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import UnifiedLens
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import rotation_from_rpy
from catoptra_server.serve.web.pages import camera_table

# Arithmetic in float64 over a few operations.
_TOLERANCE = 1e-9


@pytest.fixture(scope="module")
def page(browser: Browser, live: LiveServer) -> Iterator[Tab]:
    """A page from which modules can be imported."""
    with open_tab(browser, live.url, new_window=True) as tab:
        yield tab


def run(page: Tab, module: str, body: str) -> Any:
    """Value of a JavaScript expression of a module `m`."""
    return page.evaluate(f"import('/static/{module}.js').then((m) => {body})")


def _parse(page: Tab, line: str) -> Any:
    body = f"""{{
      const reading = m.parseReading({json.dumps(line)});
      return reading && {{ ...reading, fields: [...reading.fields] }};
    }}"""
    return run(page, "readings", body)


# The first lines are the examples of protocol/SPEC.md, 5.3.


def test_reading_of_a_scanner_keeps_its_ranges(page: Tab) -> None:
    reading = _parse(
        page,
        "SEN {Time 395.38} {Type RangeScanner} {Name Scanner1} {Resolution 0.0174} {FOV 3.1415} "
        "{Range 2.1924,2.1930}",
    )
    assert (reading["type"], reading["name"], reading["time_s"]) == (
        "RangeScanner",
        "Scanner1",
        395.38,
    )
    assert dict(reading["fields"])["range"] == "2.1924,2.1930"


def test_reading_of_sonars_has_a_part_for_each(page: Tab) -> None:
    line = "SEN {Time 395.6055} {Type Sonar} {Name F1 Range 4.5604} {Name F2 Range 2.4576}"
    reading = _parse(page, line)
    assert reading["name"] == ""
    assert reading["parts"] == [
        {"name": "F1", "quantity": "Range", "value": "4.5604"},
        {"name": "F2", "quantity": "Range", "value": "2.4576"},
    ]


def test_horizon_is_level_in_the_world_however_the_robot_is_tilted(page: Tab) -> None:
    for attitude in ((0.0, 0.0, 0.7), (0.1, 0.3, -2.0), (1.5, 0.2, 0.4), (pi - 0.1, 0.0, 1.0)):
        rotation = rotation_from_rpy(*attitude)
        pose = {"position_m": [1.0, 2.0, -3.0], "rotation": rotation.ravel().tolist()}
        frame = json.dumps({"header": {"world_from_robot": pose}})
        found = run(page, "views/directions", f"m.horizonDirections({{ frame: {frame} }})")
        in_world = np.array(found) @ rotation.T
        assert np.abs(in_world[:, 2]).max() < _TOLERANCE
        # From behind by the left, of the heading.
        assert in_world[0] @ rotation[:, 0] < 0.0
        assert np.ptp(np.unwrap(np.arctan2(in_world[:, 1], in_world[:, 0]))) == pytest.approx(
            2 * pi
        )


@pytest.mark.parametrize(
    ("line", "fields"),
    [
        ("STA{Type  GroundVehicle }{Battery 1200}", {"type": "GroundVehicle", "battery": "1200"}),
        # A block without a space has an empty name; one that is not closed does not count.
        ("sen {Type A} {type B} {x {y} {z 1", {"type": "A", "": "y"}),
        ("SEN {Type GPS} {Latitude 39,8.0341,N}", {"type": "GPS", "latitude": "39,8.0341,N"}),
        ("SEN {__proto__ 1} {constructor 2}", {"__proto__": "1", "constructor": "2"}),
    ],
)
def test_reading_follows_the_grammar_of_lines(page: Tab, line: str, fields: dict[str, str]) -> None:
    assert dict(_parse(page, line)["fields"]) == fields


@pytest.mark.parametrize("line", ["NFO {Type Sonar}", "", "{Type Sonar}", "RES {Time 1}"])
def test_line_of_another_kind_is_no_reading(page: Tab, line: str) -> None:
    assert _parse(page, line) is None


def test_last_reading_of_a_sensor_counts(page: Tab) -> None:
    reports = ["SEN {Type INS} {Name A} {X 1}", "SEN {Type INS} {Name A} {X 2}", "junk"]
    body = f"[...m.parseReadings({json.dumps(reports)})].map(([k, r]) => [k, r.fields.get('x')])"
    assert run(page, "readings", body) == [["INS/A", "2"]]


@pytest.mark.parametrize(
    ("text", "numbers"),
    [("1,2.5 -3e2", [1, 2.5, -300]), ("NoVictims", []), ("39,8.0341,N", []), ("", [])],
)
def test_numbers_of_a_value(page: Tab, text: str, numbers: list[float]) -> None:
    assert run(page, "readings", f"m.numbersOf({json.dumps(text)})") == numbers


def test_composed_pose_agrees_with_matrices(page: Tab) -> None:
    def matrix(x: float, y: float, yaw: float) -> np.ndarray:
        return np.array([[cos(yaw), -sin(yaw), x], [sin(yaw), cos(yaw), y], [0, 0, 1]])

    outer, inner = (1.0, -2.0, 2.8), (0.5, 0.25, 1.2)
    poses = [dict(zip("xy", pose[:2], strict=True), yaw=pose[2]) for pose in (outer, inner)]
    found = run(page, "scan_geometry", f"m.compose(...{json.dumps(poses)})")
    expected = matrix(*outer) @ matrix(*inner)
    assert [found["x"], found["y"]] == pytest.approx(expected[:2, 2], abs=_TOLERANCE)
    assert found["yaw"] == pytest.approx(2.8 + 1.2 - 2 * pi, abs=_TOLERANCE)


@pytest.mark.parametrize(
    ("angle", "expected"), [(pi, pi), (-pi, pi), (3 * pi, pi), (-0.1, -0.1), (2 * pi, 0.0)]
)
def test_wrapped_angle_lies_above_minus_pi_and_up_to_pi(
    page: Tab, angle: float, expected: float
) -> None:
    assert run(page, "scan_geometry", f"m.wrapped({angle!r})") == pytest.approx(expected)


def test_scan_begins_on_the_right_of_the_robot(page: Tab) -> None:
    sensor = {"x_m": 0, "y_m": 0, "yaw_rad": 0.1, "fov_rad": pi, "max_range_m": 20}
    line = "SEN {Type RangeScanner} {Name S} {FOV 3.1415} {Range 1,2,20.0000}"
    rays = page.evaluate(
        f"""Promise.all([import('/static/readings.js'), import('/static/scan_geometry.js')])
        .then(([r, g]) => g.scanRays(r.parseReading({json.dumps(line)}), {json.dumps(sensor)}))"""
    )
    # Angles are clockwise seen from above: the right is positive.
    assert [ray["angle_rad"] for ray in rays] == pytest.approx(
        [0.1 + pi / 2, 0.1, 0.1 - pi / 2], abs=1e-4
    )
    assert [ray["has_echo"] for ray in rays] == [True, True, False]


def test_pose_history_interpolates_across_the_wrap_of_angles(page: Tab) -> None:
    body = """{
      const history = new m.PoseHistory();
      history.add(1, { x: 0, y: 0, yaw: 3.1 });
      history.add(2, { x: 2, y: 1, yaw: -3.1 });
      return [history.at(0.5), history.at(1.5), history.at(9)];
    }"""
    before, between, after = run(page, "scan_geometry", body)
    assert before is None
    assert (between["x"], between["y"]) == (1, 0.5)
    assert abs(between["yaw"]) == pytest.approx(pi)
    assert after["x"] == 2


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 100.0])
def test_ellipse_agrees_with_the_eigenvectors(page: Tab, angle_deg: float) -> None:
    angle = radians(angle_deg)
    axes = np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])
    matrix = np.zeros((3, 3))
    matrix[:2, :2] = axes @ np.diag([0.09, 0.01]) @ axes.T
    found = run(page, "beliefs", f"m.positionEllipse({matrix.ravel().tolist()})")
    assert (found["major_m"], found["minor_m"]) == pytest.approx((0.6, 0.2), abs=_TOLERANCE)
    assert sin(found["angle_rad"] - angle) == pytest.approx(0.0, abs=_TOLERANCE)


@pytest.mark.parametrize("matrix", [[1, 2, 0, 2, 1, 0, 0, 0, 1], [-1, 0, 0, 0, -1, 0, 0, 0, 1]])
def test_matrix_that_is_no_covariance_has_no_ellipse(page: Tab, matrix: list[float]) -> None:
    assert run(page, "beliefs", f"m.positionEllipse({matrix})") is None


@pytest.mark.parametrize(
    "note",
    [
        None,
        7,
        {"pose": [1, 2]},
        {"pose": [1, 2, "3"]},
        {"pose": "123"},
        {"detections": {"length": 9}},
        {"detections": [None, 1, {"bearing_rad": "1"}]},
        {"text": {"a": 1}},
    ],
)
def test_note_of_a_wrong_form_is_not_drawn(page: Tab, note: object) -> None:
    state = f"{{ reply: {{ notes: [] }}, notes: new Map([['n', {json.dumps(note)}]]) }}"
    (belief,) = run(page, "beliefs", f"m.beliefsOf({state})")
    assert belief == {
        "name": "n",
        "time_s": None,
        "pose": None,
        "covariance": None,
        "detections": [],
        "text": "",
    }


@pytest.mark.parametrize(
    ("forward", "turn", "expected"),
    [
        (1, 0, [4, 4]),
        (-1, 0, [-4, -4]),
        # Left faster than right turns to the right.
        (0, 1, [2, -2]),
        (1, 1, [4, 4 / 3]),
        (-1, -1, [-4, -4 / 3]),
        (0, 0, [0, 0]),
    ],
)
def test_wheel_speeds_stay_within_the_limit(
    page: Tab, forward: float, turn: float, expected: list[float]
) -> None:
    body = f"m.wheelSpeeds({{ forward: {forward}, turn: {turn} }}, 4)"
    assert run(page, "drive_control", body) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0.1, 0), (-0.09, 0), (1, 1), (-1, -1), (0.55, 0.5), ("NaN", 0), (1.5, 1)],
)
def test_dead_zone_of_a_stick(page: Tab, value: object, expected: float) -> None:
    found = run(page, "drive_inputs", f"m.withoutDeadZone({value})")
    assert found == pytest.approx(expected)


@pytest.mark.parametrize(
    ("smallest", "step"), [(0.7, 1), (1, 1), (1.1, 2), (3, 5), (6, 10), (0.03, 0.05)]
)
def test_ticks_are_round(page: Tab, smallest: float, step: float) -> None:
    assert run(page, "time_plot", f"m.tickStep({smallest})") == pytest.approx(step)


def test_path_stays_bounded_and_keeps_both_ends(page: Tab) -> None:
    body = """{
      const path = new m.Path();
      for (let i = 0; i < 20000; i += 1) path.add({ x: 0.02 * i, y: 0 });
      return [path.points.length, path.points[0].x, path.points.at(-1).x];
    }"""
    length, first, last = run(page, "path", body)
    assert length <= 4000
    assert first == 0
    assert last == pytest.approx(399.98)


def test_names_lose_what_is_not_seen(page: Tab) -> None:
    assert run(page, "panel", r"m.shorten('a\u202eb\u0007c')") == "a\ufffdb\ufffdc"
    assert run(page, "panel", "m.shorten('x'.repeat(99), 5)") == "xxxx\u2026"


@pytest.mark.parametrize("picture", list(Picture))
def test_camera_table_of_a_decentred_lens_finds_pixels_and_angles(
    page: Tab, picture: Picture
) -> None:
    plane = ImagePlane((1.0, 0.01, 0.0, 1.02), p1=4e-3, p2=-3e-3)
    lens = UnifiedLens(2.2, 0.0168, 1.65)
    camera = OmniCamera(lens, 1400, 1400, (710.0, 690.0), 1336.0, 1.6, 0.4, picture, plane)
    theta, azimuth = np.meshgrid([0.0, 0.01, 0.7, 1.2, 1.599], [-3.0, -1.0, 0.5, 2.2])
    x, y = np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth)
    directions = np.stack((x, y, np.cos(theta)), axis=-1).reshape(-1, 3)
    expected, valid = pixel_from_direction(camera, directions)
    assert valid.all()
    body = f"""{{
      const table = new m.CameraTable({json.dumps(camera_table(camera))});
      const pixels = {directions.tolist()}.map((one) => table.pixelFromDirection(one));
      const angles = pixels.map((pixel) => table.anglesFromPixel(pixel));
      return [pixels, angles.map((one) => [one.theta_rad, one.azimuth_rad])];
    }}"""
    pixels, angles = run(page, "camera_table", body)
    # Of the linear interpolation between 4096 entries.
    assert np.abs(np.array(pixels) - expected).max() < 1e-4
    found = np.array(angles)
    assert found[:, 0] == pytest.approx(theta.ravel(), abs=1e-8)
    away = theta.ravel() > 0.0
    assert found[away, 1] == pytest.approx(azimuth.ravel()[away], abs=1e-7)


@pytest.mark.parametrize("picture", list(Picture))
def test_camera_table_when_turned_is_that_of_the_other_hand(page: Tab, picture: Picture) -> None:
    plane = ImagePlane((1.0, 0.01, 0.0, 1.02), p1=4e-3, p2=-3e-3)
    lens = UnifiedLens(2.2, 0.0168, 1.65)
    camera = OmniCamera(lens, 1400, 1300, (710.0, 690.0), 1336.0, 1.6, 0.4, picture, plane)
    (other,) = set(Picture) - {picture}
    directions = [[0.1, 0.7, 0.2], [-0.4, -0.3, 1.0], [0.9, -0.2, 0.1]]
    expected, valid = pixel_from_direction(camera.with_picture(other), np.array(directions))
    assert valid.all()
    body = f"""{{
      const table = new m.CameraTable({json.dumps(camera_table(camera))}).turned();
      return [table.picture, {directions}.map((one) => table.pixelFromDirection(one))];
    }}"""
    found, pixels = run(page, "camera_table", body)
    assert found == other.value
    assert np.abs(np.array(pixels) - expected).max() < 1e-4


def test_camera_table_has_no_angles_beyond_the_rim(page: Tab) -> None:
    plane = ImagePlane(p1=4e-3, p2=-3e-3)
    lens = UnifiedLens(2.2, 0.0168, 1.65)
    camera = OmniCamera(lens, 1400, 1400, (700.0, 700.0), 1336.0, 1.2, 0.0, plane=plane)
    rim = camera.rim_radius_px
    beyond = [[700.0 + 1.05 * rim, 700.0], [700.0, 700.0 - 3.0 * rim], [1e9, -1e9]]
    body = f"""{{
      const table = new m.CameraTable({json.dumps(camera_table(camera))});
      return {beyond}.map((pixel) => table.anglesFromPixel(pixel));
    }}"""
    assert run(page, "camera_table", body) == [None, None, None]
