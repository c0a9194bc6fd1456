"""The views that the page unwarps on the GPU, against `catoptra_client.unwarp` and known places."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from browser.chromium import Browser
from browser.live_server import (
    LiveServer,
    start_live_server,
    write_parabolic_robot,
    write_plain_robot,
)
from browser.measured_requirements import MeasuredRequirements
from browser.stream_probe import connect_probe
from browser.tab import Tab, open_tab
from catoptra_client.unwarp import (
    CylinderGeometry,
    PerspectiveGeometry,
    make_unwarp_map,
    unwarp,
)
from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera

_Image = npt.NDArray[np.uint8]
_ROBOTS: dict[str, Callable[[Path], Path]] = {
    "hyperbolic": write_plain_robot,
    "parabolic": write_parabolic_robot,
}
# White spheres around the robot, in metres: near and far, above and below the viewpoint. The
# outline of a sphere is a cone around its centre, unlike that of a box.
_MARKERS_M = ((2.0, 0.0, -0.6), (0.0, 1.5, -0.3), (-1.2, -1.2, -0.9), (0.8, -1.6, -0.1))
_RADIUS_M = 0.06
_COLUMNS = 960
# Half a side of the square around a marker in a panorama, with no other marker in it.
_WINDOW_PX = 16

# A frame as PNG and a view of that same frame: the JPEG that the page draws does not count, and no
# newer frame comes between.
_READ_VIEW = """async (kind, view) => {
  const { context } = catoptra;
  const { robot, camera } = context.selected;
  const { bytes } = await context.pictures.requestFrame({ robot, camera, encoding: "png" });
  const options = { colorSpaceConversion: "none", premultiplyAlpha: "none" };
  const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }), options);
  const { chooseCylinder } = await import("/static/camera_table.js");
  const isPanorama = kind === "panorama";
  const geometry = isPanorama ? chooseCylinder(context.table, view.columns) : view;
  const pixels = await context.unwarper.read(geometry, bitmap);
  const base64 = (data) => new Promise((resolve) => {
    const reader = new FileReader();
    reader.onload = () => resolve(reader.result.split(",")[1]);
    reader.readAsDataURL(new Blob([data]));
  });
  const [width, height] = [view.columns ?? view.width_px, geometry.rows ?? view.height_px];
  return { png: await base64(bytes), pixels: await base64(pixels), width, height, geometry };
}"""


@pytest.fixture(scope="module", params=_ROBOTS)
def mirror(request: pytest.FixtureRequest) -> str:
    """Name of the mirror."""
    return str(request.param)


@pytest.fixture(scope="module")
def field_page(
    browser: Browser, mirror: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[LiveServer, Tab]]:
    """The field seen by a mirror."""
    folder = tmp_path_factory.mktemp(mirror)
    with (
        start_live_server(folder, _ROBOTS[mirror](folder)) as live,
        connect_probe(live.server.stream_port) as owner,
    ):
        owner.spawn("Seer", -0.7, 0.4)
        with open_tab(browser, live.url, new_window=True) as tab:
            _wait_for_table(tab)
            yield live, tab


@pytest.fixture(scope="module")
def marker_page(
    browser: Browser, mirror: str, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[LiveServer, Tab]]:
    """White markers on black seen by a mirror."""
    folder = tmp_path_factory.mktemp(f"markers_{mirror}")
    trimesh.creation.icosphere(subdivisions=3, radius=_RADIUS_M).export(folder / "sphere.stl")
    world = folder / "markers.ini"
    spheres = (
        f'Meshes=(File="sphere.stl",Position=(X={x},Y={y},Z={z}),'
        "Colour=(R=255,G=255,B=255),Unlit=true)"
        for x, y, z in _MARKERS_M
    )
    world.write_text("\n".join(("[Catoptra.World]", *spheres)) + "\n", encoding="utf-8")
    with (
        start_live_server(folder, _ROBOTS[mirror](folder), world=world) as live,
        connect_probe(live.server.stream_port) as owner,
    ):
        owner.spawn("Seer", 0.0, 0.0)
        with open_tab(browser, live.url, new_window=True) as tab:
            _wait_for_table(tab)
            yield live, tab


def _wait_for_table(tab: Tab) -> None:
    tab.wait_for(
        "window.catoptra?.context.table && catoptra.context.unwarper.isReady", "picture", 15.0
    )


def _read_view(tab: Tab, kind: str, **view: object) -> tuple[_Image, _Image, dict[str, Any]]:
    """Frame and view (h, w, 3) RGB, and the reply of the page."""
    reply = tab.invoke(_READ_VIEW, kind, view, limit_s=30.0)
    encoded = np.frombuffer(base64.b64decode(reply["png"]), np.uint8)
    frame = cv2.cvtColor(cv2.imdecode(encoded, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    pixels = np.frombuffer(base64.b64decode(reply["pixels"]), np.uint8)
    image = pixels.reshape(reply["height"], reply["width"], 4)[..., :3]
    return np.asarray(frame, np.uint8), image, reply


def _camera(live: LiveServer) -> OmniCamera:
    """Model of the camera, from a header of the stream."""
    header, _ = live.probe.get_png("Seer")
    assert header.camera_model is not None
    return omni_camera_from_pairs(tuple(header.camera_model.items()))[0]


def _cylinder(reply: dict[str, Any]) -> CylinderGeometry:
    """Geometry of the panorama that the page has drawn."""
    names = ("columns", "rows", "top_slope", "bottom_slope", "seam_azimuth_rad")
    return CylinderGeometry(**{name: reply["geometry"][name] for name in names})


def _fraction_within(image: _Image, reference: _Image, levels: int) -> tuple[float, int]:
    """Fraction of the pixels whose colours all differ by at most some levels; the largest."""
    difference = np.abs(image.astype(np.int16) - reference.astype(np.int16)).max(axis=-1)
    return float(np.mean(difference <= levels)), int(difference.max())


def test_panorama_when_drawn_by_the_page_equals_that_of_the_client(
    field_page: tuple[LiveServer, Tab], mirror: str, requirements: MeasuredRequirements
) -> None:
    live, tab = field_page
    frame, image, reply = _read_view(tab, "panorama", columns=_COLUMNS)
    reference = unwarp(frame, make_unwarp_map(_camera(live), _cylinder(reply)))
    assert reference.std() > 20.0, "the frame shows a scene"
    fraction, largest = _fraction_within(image, reference, 2)
    requirements.check(
        f"GPU's panorama within 2 grey levels of unwarp on 99.5 % of pixels ({mirror})",
        f"{100.0 * fraction:.2f} % of {image.shape[1]} x {image.shape[0]} px, largest {largest}",
        is_met=fraction >= 0.995,
    )


def test_perspective_view_when_drawn_by_the_page_equals_that_of_the_client(
    field_page: tuple[LiveServer, Tab], mirror: str, requirements: MeasuredRequirements
) -> None:
    live, tab = field_page
    view = {"width_px": 480, "height_px": 360, "fov_rad": 1.2, "yaw_rad": 0.7, "pitch_rad": -0.3}
    frame, image, _ = _read_view(tab, "perspective", **view)
    geometry = PerspectiveGeometry(480, 360, 1.2, yaw_rad=0.7, pitch_rad=-0.3)
    reference = unwarp(frame, make_unwarp_map(_camera(live), geometry))
    fraction, largest = _fraction_within(image, reference, 2)
    requirements.check(
        f"GPU's perspective view within 2 grey levels on 99.5 % of pixels ({mirror})",
        f"{100.0 * fraction:.2f} %, largest {largest}",
        is_met=fraction >= 0.995,
    )


def _centroid(image: _Image, near: Floats) -> Floats:
    """(2,) centroid (column, row) of the light in a square around a (2,) position."""
    column, row = np.round(near).astype(int)
    rows = slice(max(row - _WINDOW_PX, 0), row + _WINDOW_PX)
    columns = slice(max(column - _WINDOW_PX, 0), column + _WINDOW_PX)
    light = image[rows, columns].sum(axis=-1, dtype=np.float64)
    assert light.sum() > 0.0, f"no marker near {near}"
    v, u = np.mgrid[rows, columns][:, : light.shape[0], : light.shape[1]] + 0.5
    centroid: Floats = np.array(((u * light).sum(), (v * light).sum())) / light.sum()
    return centroid


def _marker_positions(live: LiveServer, geometry: CylinderGeometry) -> Floats:
    """(n, 2) columns and rows at which a panorama shows the markers' centres."""
    header, _ = live.probe.get_png("Seer")
    points = np.array(_MARKERS_M)
    assert header.robot_from_mirror is not None
    for transform in (header.world_from_robot, header.robot_from_mirror):
        rotation = np.array(transform.rotation).reshape(3, 3)
        points = (points - transform.position_m) @ rotation
    x, y, z = points.T
    columns = geometry.column_from_azimuth(np.arctan2(y, x))
    return np.stack((columns, geometry.row_from_slope(z / np.hypot(x, y))), axis=-1)


def test_markers_when_unwarped_by_the_page_are_at_their_positions(
    marker_page: tuple[LiveServer, Tab], mirror: str, requirements: MeasuredRequirements
) -> None:
    live, tab = marker_page
    frame, image, reply = _read_view(tab, "panorama", columns=_COLUMNS)
    geometry = _cylinder(reply)
    reference = unwarp(frame, make_unwarp_map(_camera(live), geometry))
    expected = _marker_positions(live, geometry)
    measured = np.array([_centroid(image, position) for position in expected])
    client = np.array([_centroid(reference, position) for position in expected])
    from_client = np.linalg.norm(measured - client, axis=-1).max()
    from_truth = np.linalg.norm(measured - expected, axis=-1).max()
    requirements.check(
        f"a marker's centroid within 0.1 px of that in unwarp's panorama ({mirror})",
        f"{from_client:.3f} px; {from_truth:.3f} px from the projected centre",
        is_met=bool(from_client <= 0.1 and from_truth <= 0.1),
    )
