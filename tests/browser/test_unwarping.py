"""The views that the page unwarps on the GPU, against `catoptra_client.unwarp` and known places."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import trimesh

from browser.camera_pages import CAMERA_CASES, CameraPage, Image, open_camera_page
from browser.chromium import Browser
from browser.measured_requirements import MeasuredRequirements
from catoptra_client.unwarp import CylinderGeometry, PerspectiveGeometry, unwarp
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from helpers.configs import FIELD

# White spheres around the robot, in metres: near and far, above and below the viewpoint. The
# outline of a sphere is a cone around its centre, unlike that of a box.
_MARKERS_M = ((2.0, 0.0, -0.6), (0.0, 1.5, -0.3), (-1.2, -1.2, -0.9), (0.8, -1.6, -0.1))
_RADIUS_M = 0.06
_COLUMNS = 960
# Of a marker in a panorama, at most: its light reaches as far from the centre.
_RADIUS_PX = 10
# Half a side of the square around a marker in a panorama, with no other marker in it.
_WINDOW_PX = 16


@pytest.fixture(scope="module", params=CAMERA_CASES)
def camera(request: pytest.FixtureRequest) -> str:
    """Name of the case."""
    return str(request.param)


@pytest.fixture(scope="module")
def field_page(
    browser: Browser, camera: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[CameraPage]:
    """The field seen by a camera."""
    folder = tmp_path_factory.mktemp("field")
    with open_camera_page(browser, camera, folder, world=FIELD, x_m=-0.7, y_m=0.4) as page:
        yield page


@pytest.fixture(scope="module")
def marker_page(
    browser: Browser, camera: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[CameraPage]:
    """White markers on black seen by a camera."""
    folder = tmp_path_factory.mktemp("markers")
    trimesh.creation.icosphere(subdivisions=3, radius=_RADIUS_M).export(folder / "sphere.stl")
    world = folder / "markers.ini"
    spheres = (
        f'Meshes=(File="sphere.stl",Position=(X={x},Y={y},Z={z}),'
        "Colour=(R=255,G=255,B=255),Unlit=true)"
        for x, y, z in _MARKERS_M
    )
    world.write_text("\n".join(("[Catoptra.World]", *spheres)) + "\n", encoding="utf-8")
    with open_camera_page(browser, camera, folder, world=world, x_m=0.0, y_m=0.0) as page:
        yield page


def _cylinder(reply: dict[str, Any]) -> CylinderGeometry:
    """Geometry of the panorama that the page has drawn."""
    names = ("columns", "rows", "top_slope", "bottom_slope", "seam_azimuth_rad")
    return CylinderGeometry(**{name: reply["geometry"][name] for name in names})


def _fraction_within(
    image: Image, reference: Image, valid: Bools, levels: int
) -> tuple[float, int]:
    """Fraction of the valid pixels whose colours all differ by at most some levels; the largest.

    The others are black, but for those at the border of what the camera shows.
    """
    if not valid.all():
        assert np.mean(image[~valid].max(axis=-1) == 0) >= 0.995
    difference = np.abs(image.astype(np.int16) - reference.astype(np.int16)).max(axis=-1)[valid]
    return float(np.mean(difference <= levels)), int(difference.max())


def test_panorama_when_drawn_by_the_page_equals_that_of_the_client(
    field_page: CameraPage, camera: str, requirements: MeasuredRequirements
) -> None:
    frame, image, reply = field_page.read_view("panorama", columns=_COLUMNS)
    unwarp_map = field_page.make_map(_cylinder(reply))
    reference = unwarp(frame, unwarp_map)
    assert reference.std() > 20.0, "the frame shows a scene"
    fraction, largest = _fraction_within(image, reference, unwarp_map.valid, 2)
    requirements.check(
        f"GPU's panorama within 2 grey levels of unwarp on 99.5 % of pixels ({camera})",
        f"{100.0 * fraction:.2f} % of {image.shape[1]} x {image.shape[0]} px, largest {largest}",
        is_met=fraction >= 0.995,
    )


def test_perspective_view_when_drawn_by_the_page_equals_that_of_the_client(
    field_page: CameraPage, camera: str, requirements: MeasuredRequirements
) -> None:
    view = {"width_px": 480, "height_px": 360, "fov_rad": 1.2, "yaw_rad": 0.7, "pitch_rad": -0.3}
    frame, image, _ = field_page.read_view("perspective", **view)
    geometry = PerspectiveGeometry(480, 360, 1.2, yaw_rad=0.7, pitch_rad=-0.3)
    unwarp_map = field_page.make_map(geometry)
    reference = unwarp(frame, unwarp_map)
    assert reference.std() > 20.0, "the view shows a scene"
    fraction, largest = _fraction_within(image, reference, unwarp_map.valid, 2)
    requirements.check(
        f"GPU's perspective view within 2 grey levels on 99.5 % of pixels ({camera})",
        f"{100.0 * fraction:.2f} %, largest {largest}",
        is_met=fraction >= 0.995,
    )


def _centroid(image: Image, near: Floats) -> Floats:
    """(2,) centroid (column, row) of the light in a square around a (2,) position."""
    light = image[_window(near)].sum(axis=-1, dtype=np.float64)
    assert light.sum() > 0.0, f"no marker near {near}"
    rows, columns = _window(near)
    v, u = np.mgrid[rows, columns][:, : light.shape[0], : light.shape[1]] + 0.5
    centroid: Floats = np.array(((u * light).sum(), (v * light).sum())) / light.sum()
    return centroid


def _window(near: Floats) -> tuple[slice, slice]:
    """Rows and columns of the square around a (2,) position (column, row)."""
    column, row = np.round(near).astype(int)
    rows = slice(max(row - _WINDOW_PX, 0), row + _WINDOW_PX)
    return rows, slice(max(column - _WINDOW_PX, 0), column + _WINDOW_PX)


def _is_whole(valid: Bools, position: Floats) -> bool:
    """Whether a camera shows all around a (2,) position (column, row) of a panorama."""
    row = position[1]
    is_inside = _RADIUS_PX <= row <= len(valid) - _RADIUS_PX
    return bool(is_inside and valid[_window(position)].all())


def _positions(geometry: CylinderGeometry, directions: Floats) -> Floats:
    """(n, 2) columns and rows of a panorama in (n, 3) directions."""
    x, y, z = directions.T
    columns = geometry.column_from_azimuth(np.arctan2(y, x))
    return np.stack((columns, geometry.row_from_slope(z / np.hypot(x, y))), axis=-1)


def test_markers_when_unwarped_by_the_page_are_where_it_marks_them(
    marker_page: CameraPage, camera: str, requirements: MeasuredRequirements
) -> None:
    frame, image, reply = marker_page.read_view("panorama", columns=_COLUMNS)
    geometry = _cylinder(reply)
    unwarp_map = marker_page.make_map(geometry)
    reference = unwarp(frame, unwarp_map)
    marked = _positions(geometry, marker_page.mark_points(np.array(_MARKERS_M)))
    # A camera that looks ahead does not show those behind, nor a cone those far above.
    marked = np.array([one for one in marked if _is_whole(unwarp_map.valid, one)])
    assert len(marked) >= 2
    measured = np.array([_centroid(image, position) for position in marked])
    client = np.array([_centroid(reference, position) for position in marked])
    from_client = np.linalg.norm(measured - client, axis=-1).max()
    from_mark = np.linalg.norm(measured - marked, axis=-1).max()
    requirements.check(
        f"a marker's centroid within 0.1 px of that in unwarp's panorama ({camera})",
        f"{from_client:.3f} px; {from_mark:.3f} px from its mark, {len(marked)} markers",
        is_met=bool(from_client <= 0.1 and from_mark <= 0.1),
    )


def test_landmarks_when_marked_by_the_page_are_at_the_pixels_of_the_server(
    field_page: CameraPage, camera: str, requirements: MeasuredRequirements
) -> None:
    pairs = field_page.mark_landmarks()
    assert len(pairs) >= 3
    error = max(math.dist(pixel, marked) for pixel, marked in pairs)
    requirements.check(
        f"a landmark's mark within 0.1 px of its pixel ({camera})",
        f"{error:.1e} px, {len(pairs)} landmarks",
        is_met=error <= 0.1,
    )


def test_cursor_when_placed_shows_azimuth_and_elevation_in_the_axes_of_the_robot(
    field_page: CameraPage,
) -> None:
    tab = field_page.tab
    model, rotation = field_page.read_camera()
    pixel = np.array([0.4 * model.width_px, 0.3 * model.height_px])
    direction, valid = direction_from_pixel(model, pixel)
    assert valid
    x, y, z = rotation @ direction
    angles = math.atan2(y, x), math.atan2(-z, math.hypot(x, y))
    tab.evaluate(f"catoptra.context.setCursor({pixel.tolist()}, true)")
    for name, angle in zip(("azimuth", "elevation"), angles, strict=True):
        text = f"{math.degrees(angle):.2f}°"
        shown = f"document.evaluate('//dt[.=\"{name}\"]/following-sibling::dd[1]', document)"
        tab.wait_for(f"{shown}.iterateNext()?.textContent === {text!r}", f"{name} {text}", 5.0)


def test_arrow_keys_when_pressed_on_the_panorama_turn_about_the_vertical(
    field_page: CameraPage,
) -> None:
    tab = field_page.tab
    overlay = "#panel-panorama .overlay"
    tab.evaluate("catoptra.context.setCursor(null)")
    tab.evaluate(f"document.querySelector('{overlay}').focus()")
    for key in ("ArrowRight", "ArrowRight", "ArrowDown"):
        tab.press(key)
    model, rotation = field_page.read_camera()
    pixel = np.array(tab.evaluate("catoptra.context.cursor.pixel"))
    direction, valid = direction_from_pixel(model, pixel)
    assert valid
    x, y, z = rotation @ direction
    # The first key shows the cursor, straight ahead; each further one is a step of two degrees.
    assert math.degrees(math.atan2(y, x)) == pytest.approx(2.0, abs=1e-3)
    assert math.degrees(math.atan2(z, math.hypot(x, y))) == pytest.approx(2.0, abs=1e-3)
    tab.press("Escape")
