"""What the page reads by GET: files, tables of cameras, the floor plan, the description."""

from __future__ import annotations

import asyncio
import base64
import dataclasses
import io
import json
import math
import threading
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import EquidistantLens, UnifiedLens
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, ConicalMirror, Mirror, SphericalMirror
from catoptra_protocol.optics.mirrors.parabolic import ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    camera_with_inscribed_rim,
    pixel_from_direction,
)
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.__main__ import main
from catoptra_server.config.robot_file import read_robot, read_robots
from catoptra_server.config.world_file import read_world
from catoptra_server.serve.stream.replies import build_server_info
from catoptra_server.serve.web import pages as pages_module
from catoptra_server.serve.web.pages import (
    WebPages,
    WebResource,
    camera_table,
    describe_server,
    floor_plan,
    read_page_files,
)
from catoptra_server.simulation.floor_plan import measure_robot
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.configs import ROBOTS, WORLDS
from helpers.fake_simulation import SERVER_INFO
from helpers.live_page import FILES
from helpers.worlds import make_test_world


def test_files_are_found_by_address_with_their_types(tmp_path: Path) -> None:
    (tmp_path / "panels").mkdir()
    contents = {
        "index.html": "<!DOCTYPE html>",
        "style.css": "body {}",
        "panels/map.js": "export {};",
        "icon.svg": "<svg/>",
        "notes.py": "secret",
        "README": "secret",
    }
    for name, text in contents.items():
        (tmp_path / name).write_text(text)
    files = read_page_files(tmp_path)
    assert {path: file.content_type for path, file in files.items()} == {
        "/": "text/html; charset=utf-8",
        "/static/style.css": "text/css; charset=utf-8",
        "/static/panels/map.js": "text/javascript; charset=utf-8",
        "/static/icon.svg": "image/svg+xml",
    }
    assert files["/static/panels/map.js"].body == b"export {};"


def test_folder_without_a_page_has_no_index(tmp_path: Path) -> None:
    assert read_page_files(tmp_path) == {}
    assert read_page_files(tmp_path / "missing") == {}


def test_tag_changes_with_the_body_alone() -> None:
    first, same, other = (WebResource.from_body("text/plain", body) for body in (b"a", b"a", b"b"))
    assert first.etag == same.etag != other.etag
    assert first.etag.startswith('"')
    assert first.etag.endswith('"')


def test_every_file_of_the_page_but_licences_is_served() -> None:
    files = [
        file
        for file in Path(pages_module.__file__).with_name("static").rglob("*")
        if file.is_file()
    ]
    served = read_page_files()
    assert "/" in served
    assert len(served) == len([file for file in files if "LICENSE" not in file.name])


# What the page may miss: a hundredth of what is seen, and more than interpolation costs.
TOLERANCE_PX = 1e-4


def pixel_from_table(table: dict[str, Any], theta_rad: Floats, phi_rad: Floats) -> Floats:
    """Pixels (..., 2) as the page computes them."""
    a, b, c, d = table["azimuth_matrix"]
    thetas = np.linspace(0.0, table["max_theta_rad"], len(table["radius_px"]))
    radius = np.interp(theta_rad, thetas, table["radius_px"])
    x, y = np.cos(phi_rad), np.sin(phi_rad)
    u, v = table["centre_px"]
    pixel = np.stack((u + radius * (a * x + b * y), v + radius * (c * x + d * y)), axis=-1)
    if "decentring_px" in table:
        squared = np.interp(theta_rad, thetas, table["decentring_px"])
        matrix = np.reshape(table["decentring_matrix"], (2, 3))
        pixel += squared[..., None] * (np.stack((x * x, x * y, y * y), axis=-1) @ matrix.T)
    return pixel


def make_camera(mirror: Mirror, *, up_rad: float, is_cropped: bool) -> OmniCamera:
    if not is_cropped:
        return camera_with_inscribed_rim(
            mirror,
            width_px=640,
            height_px=640,
            rim_rad=math.radians(110.0),
            image_up_azimuth_rad=up_rad,
        )
    return OmniCamera(mirror, 640, 480, (301.5, 222.25), 190.0, math.radians(115.0), up_rad)


@pytest.mark.parametrize(
    "mirror", [PAPER_MIRROR, ParabolicMirror(0.5)], ids=["hyperbolic", "parabolic"]
)
@pytest.mark.parametrize("up_rad", [0.0, 0.5 * math.pi, -2.0])
@pytest.mark.parametrize("is_cropped", [False, True])
def test_pixels_of_the_table_are_those_of_the_model(
    mirror: Mirror, up_rad: float, is_cropped: bool
) -> None:
    camera = make_camera(mirror, up_rad=up_rad, is_cropped=is_cropped)
    theta, phi = np.meshgrid(
        np.linspace(0.0, camera.rim_rad, 1237), np.linspace(-math.pi, math.pi, 37)
    )
    direction = np.stack(
        (np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), axis=-1
    )
    expected, valid = pixel_from_direction(camera, direction)
    # The rim itself may round to either side.
    assert valid[:, :-1].all()
    table = camera_table(camera)
    difference = np.abs(pixel_from_table(table, theta, phi) - expected)[valid]
    assert difference.max() < TOLERANCE_PX


def test_table_states_image_and_domain() -> None:
    camera = make_camera(PAPER_MIRROR, up_rad=0.0, is_cropped=True)
    table = camera_table(camera)
    assert table["kind"] == "radial"
    assert (table["width_px"], table["height_px"]) == (640, 480)
    assert table["picture"] == "mirrored"
    assert table["centre_px"] == (301.5, 222.25)
    assert table["min_theta_rad"] == 0.0
    assert table["max_theta_rad"] == camera.rim_rad
    radius_px = table["radius_px"]
    assert isinstance(radius_px, list)
    assert len(radius_px) == 4096
    assert radius_px[0] == 0.0
    assert radius_px[-1] == pytest.approx(camera.rim_radius_px, abs=1e-9)
    assert np.all(np.diff(radius_px) > 0.0)


@pytest.mark.parametrize("picture", list(Picture))
def test_table_of_a_stretched_lens_gives_its_pixels(picture: Picture) -> None:
    plane = ImagePlane((1.0, 0.01, 0.0, 1.02))
    lens = EquidistantLens()
    camera = OmniCamera(lens, 640, 480, (310.0, 250.0), 120.0, math.pi, 0.4, picture, plane)
    assert_table_projects(camera, np.radians([1.0, 45.0, 90.0, 170.0]))


@pytest.mark.parametrize("picture", list(Picture))
def test_table_of_a_decentred_lens_gives_its_pixels(picture: Picture) -> None:
    # Ten times the tangential distortion of a published fish-eye: it moves the rim by 3.5 px.
    plane = ImagePlane((1.0, 0.01, 0.0, 1.02), p1=4e-3, p2=-3e-3)
    lens = UnifiedLens(2.2, 0.0168, 1.65)
    camera = OmniCamera(lens, 1400, 1400, (710.0, 690.0), 1336.0, 1.6, 0.4, picture, plane)
    radial = replace(camera, plane=replace(plane, p1=0.0, p2=0.0))
    assert "decentring_px" not in camera_table(radial)
    theta_rad = np.array([0.01, 0.5, 1.0, 1.6])
    assert_table_projects(camera, theta_rad)
    displaced = [pixels_of_model(one, theta_rad, 1.0) for one in (camera, radial)]
    assert np.abs(displaced[0] - displaced[1])[-1].max() > 3.0


def test_table_of_a_cone_begins_at_its_apex() -> None:
    cone = ConicalMirror(math.radians(60.0), 0.1, math.radians(88.0))
    camera = camera_with_inscribed_rim(cone, width_px=360, height_px=360, rim_rad=cone.rim_rad)
    assert_table_projects(camera, np.radians([61.0, 75.0, 87.0]))
    assert camera_table(camera)["min_theta_rad"] == pytest.approx(math.radians(60.0))


def test_table_of_a_ball_states_where_its_rays_begin() -> None:
    ball = SphericalMirror(0.03, 0.2, math.radians(120.0))
    camera = camera_with_inscribed_rim(ball, width_px=360, height_px=360, rim_rad=ball.rim_rad)
    table: Any = camera_table(camera)
    pixels = np.array([(180.5, 180.0), (200.0, 300.0), (40.0, 100.0)])
    origins, directions, valid = ray_from_pixel(camera, pixels)
    assert valid.all()
    x, y, z = directions.T
    thetas = np.linspace(0.0, table["max_theta_rad"], len(table["surface_r_m"]))
    theta_rad = np.arctan2(np.hypot(x, y), z)
    r, depth = (np.interp(theta_rad, thetas, table[f"surface_{name}_m"]) for name in "rz")
    assert r == pytest.approx(np.hypot(origins[:, 0], origins[:, 1]), abs=1e-8)
    assert depth == pytest.approx(origins[:, 2], abs=1e-8)


def test_table_of_a_camera_with_a_viewpoint_has_no_surface() -> None:
    camera = make_camera(PAPER_MIRROR, up_rad=0.0, is_cropped=False)
    assert "surface_r_m" not in camera_table(camera)
    ball = SphericalMirror(0.03, 0.2, math.radians(120.0))
    exact = camera_with_inscribed_rim(ball, width_px=360, height_px=360, rim_rad=ball.rim_rad)
    assert "surface_r_m" not in camera_table(replace(exact, is_approximated=True))


def assert_table_projects(camera: OmniCamera, theta_rad: Floats) -> None:
    """Check pixels by the table against the model's."""
    table: Any = camera_table(camera)
    for azimuth in (0.0, 1.0, -2.5):
        found = pixel_from_table(table, theta_rad, np.full_like(theta_rad, azimuth))
        assert found == pytest.approx(pixels_of_model(camera, theta_rad, azimuth), abs=1e-3)


def pixels_of_model(camera: OmniCamera, theta_rad: Floats, azimuth_rad: float) -> Floats:
    """Pixels (n, 2) of the camera model at (n,) incidence angles."""
    sine = np.sin(theta_rad)
    x, y = math.cos(azimuth_rad), math.sin(azimuth_rad)
    direction = np.stack((sine * x, sine * y, np.cos(theta_rad)), axis=-1)
    pixels, valid = pixel_from_direction(camera, direction)
    assert valid.all()
    return pixels


def test_floor_plan_is_the_picture_of_the_map(tmp_path: Path) -> None:
    robot, _ = read_robot(ROBOTS / "p2at_omni.ini")
    world, _ = read_world(WORLDS / "four_legged_2006.ini")
    info = build_server_info((robot,), world, clock="lockstep", plans={})
    plan: Any = floor_plan(build_scene(world), info, *measure_robot(robot))
    picture = decode_picture(plan)
    height, width = picture.shape[:2]
    assert max(picture.shape) == 1000
    xmin, ymin, xmax, ymax = plan["bounds"]
    assert (xmax - xmin) / width == pytest.approx((ymax - ymin) / height, rel=2e-3)
    for start in world.starts:
        assert xmin < start.location_m[0] < xmax
        assert ymin < start.location_m[1] < ymax
    # Without the marks on it, and at the resolution before it is reduced.
    out = tmp_path / "plan.png"
    words = ["map", "four_legged_2006", "--size", "500", "--out", str(out)]
    assert main(words) == 0
    drawn = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).astype(int)
    map_ = np.asarray(Image.open(out)).astype(int)[: drawn.shape[0], : drawn.shape[1]]
    assert (np.abs(drawn - map_).max(axis=-1) <= 2).mean() > 0.9
    assert (picture == plan["colours"]["obstacle"]).all(axis=-1).any()


def decode_picture(plan: Mapping[str, Any]) -> npt.NDArray[np.uint8]:
    image = Image.open(io.BytesIO(base64.b64decode(plan["picture"])))
    return np.asarray(image)


def test_floor_plan_of_an_empty_world_is_paper() -> None:
    scene = build_scene(World("empty", ()))
    picture = decode_picture(floor_plan(scene, SERVER_INFO, 0.6, 0.3))
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) == 1


def describe(name: str) -> Any:
    robots, _ = read_robots(ROBOTS / f"{name}.ini")
    info = build_server_info(robots, make_test_world(), clock="lockstep", plans={})
    return json.loads(json.dumps(describe_server(info), allow_nan=False))


def test_server_of_the_stream_is_described_with_starts_and_landmarks() -> None:
    description = json.loads(json.dumps(describe_server(SERVER_INFO), allow_nan=False))
    assert description["server"] == "Catoptra test"
    assert (description["world"], description["clock"]) == ("field", "lockstep")
    assert description["start_poses"] == [
        {"name": "Centre", "location_m": [1.0, 2.0, 3.0], "rotation_rad": [0.0, 0.0, 0.5]}
    ]
    (landmark,) = description["landmarks"]
    fields = {field.name for field in dataclasses.fields(SERVER_INFO.landmarks[0])}
    assert set(landmark) == fields | {"pixel", "visible"}
    assert description["polygons"] == [16, 64, 256, 1024, 4096]
    assert description["renderers"] == ["trace", "raster"]


def test_robot_with_all_sensors_has_its_cameras_and_range_sensors() -> None:
    (robot, *_) = describe("p2at_omni_full")["classes"]
    assert robot["wheel_radius_m"] > 0.0
    assert len(robot["size_m"]) == 3
    kinds = {camera["kind"] for camera in robot["cameras"]}
    assert kinds == {"omni", "perspective"}
    sensors = robot["sensors"]
    assert {sensor["type"] for sensor in sensors} == {"RangeScanner", "Sonar"}
    for sensor in sensors:
        assert -math.pi <= sensor["yaw_rad"] <= math.pi
        assert 0.0 < sensor["fov_rad"] <= 2.0 * math.pi
        assert sensor["max_range_m"] > 0.0
        assert math.hypot(sensor["x_m"], sensor["y_m"]) < 1.0


def test_effects_of_a_camera_are_those_of_the_robot_file() -> None:
    (robot, *_) = describe("p2at_omni_real")["classes"]
    (camera,) = [camera for camera in robot["cameras"] if camera["kind"] == "omni"]
    assert "SelfView" in camera["effects"]
    assert len(camera["effects"]) == len(set(camera["effects"])) > 5


@pytest.mark.parametrize(
    ("name", "expected"), [("p2at_omni", True), ("p2at_sphere", False), ("p2at_fisheye", False)]
)
def test_omnidirectional_cameras_state_whether_a_mesh_can_stand_for_their_mirror(
    name: str, expected: bool
) -> None:
    (robot, *_) = describe(name)["classes"]
    assert {camera["has_mesh"] for camera in robot["cameras"]} == {expected}


@pytest.mark.parametrize("name", ["p2at_omni", "p2at_omni_full"])
def test_class_names_are_those_that_can_be_spawned(name: str) -> None:
    robots, _ = read_robots(ROBOTS / f"{name}.ini")
    names = [robot["class_name"] for robot in describe(name)["classes"]]
    assert names == [robot.class_name for robot in robots]


(ROBOT,) = SERVER_INFO.robots
assert ROBOT.omni_camera is not None
CAMERA = {"class": ROBOT.class_name, "camera": ROBOT.omni_camera.name}


def make_pages() -> WebPages:
    return WebPages(FILES, SERVER_INFO, build_scene(make_test_world()))


async def test_files_and_descriptions_are_found() -> None:
    pages = make_pages()
    assert await pages.find("/", {}) is FILES["/"]
    for path, key in [("/api/server.json", "classes"), ("/api/floor_plan.json", "picture")]:
        document = await pages.find(path, CAMERA | {"ignored": "1"})
        assert document is not None
        assert document.content_type.startswith("application/json")
        assert json.loads(document.body)[key]
    table = await pages.find("/api/camera_table.json", CAMERA)
    assert table is not None
    assert json.loads(table.body)["kind"] == "radial"


@pytest.mark.parametrize(
    ("path", "query"),
    [
        *(("/index.html", {}), ("/static", {}), ("/static/", {}), ("//", {}), ("", {})),
        *(("/static/../web_pages.py", {}), ("/static//etc/passwd", {}), ("/api", {})),
        *(("/static/main.js\0", {}), ("/static/%2e%2e/x", {}), ("/api/camera_table.json", {})),
        ("/api/camera_table.json", CAMERA | {"camera": "Other"}),
        *(("/api/floor_plan.json", {}), ("/api/floor_plan.json", {"class": "Other"})),
        ("/api/camera_table.json", {"camera": CAMERA["camera"]}),
    ],
)
async def test_address_when_unknown_has_no_document(path: str, query: dict[str, str]) -> None:
    assert await make_pages().find(path, query) is None


async def test_description_for_many_requests_is_made_once_although_one_is_cancelled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: list[object] = []
    may_end = threading.Event()

    def make(info: object) -> dict[str, object]:
        calls.append(info)
        assert may_end.wait(20.0)
        return {}

    monkeypatch.setattr(pages_module, "describe_server", make)
    pages = make_pages()
    first, *others = (asyncio.create_task(pages.find("/api/server.json", {})) for _ in range(4))
    await asyncio.sleep(0)
    first.cancel()
    await asyncio.gather(first, return_exceptions=True)
    may_end.set()
    documents = await asyncio.gather(*others)
    assert first.cancelled()
    assert documents[0] is documents[1] is documents[2]
    assert len(calls) == 1


async def test_description_when_it_fails_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    results = iter([ZeroDivisionError("injected"), {}])

    def make(*_: object) -> object:
        result = next(results)
        if isinstance(result, Exception):
            raise result
        return result

    monkeypatch.setattr(pages_module, "floor_plan", make)
    pages = make_pages()
    with pytest.raises(ZeroDivisionError):
        await pages.find("/api/floor_plan.json", CAMERA)
    assert await pages.find("/api/floor_plan.json", CAMERA) is not None


async def test_floor_plans_are_drawn_one_at_a_time_and_once_for_robots_of_a_size(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn: list[float] = []
    running: list[float] = []

    def draw(_scene: object, _info: object, height_m: float, _radius_m: float) -> object:
        running.append(height_m)
        assert len(running) == 1
        drawn.append(height_m)
        # Others would begin meanwhile.
        asyncio.run_coroutine_threadsafe(asyncio.sleep(0), loop).result()
        running.remove(height_m)
        return {"number": len(drawn)}

    loop = asyncio.get_running_loop()
    monkeypatch.setattr(pages_module, "floor_plan", draw)
    twin = replace(ROBOT, class_name="Twin")
    drive = replace(ROBOT.drive, collision_dimensions_m=(2.0, 1.0, 3.0))
    others = [replace(ROBOT, class_name=f"Large{i}", drive=drive) for i in range(2)]
    info = replace(SERVER_INFO, robots=(ROBOT, twin, *others))
    pages = WebPages(FILES, info, build_scene(make_test_world()))
    names = [robot.class_name for robot in info.robots] * 20
    found = await asyncio.gather(
        *(pages.find("/api/floor_plan.json", {"class": name}) for name in names)
    )
    assert len({one.etag for one in found if one is not None}) == len(drawn) == 2
    assert None not in found
    assert found[0] is found[1] is not found[2] is found[3]
