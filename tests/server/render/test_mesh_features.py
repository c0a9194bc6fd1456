"""Files of one feature each, in both renderers: the colours that formats demand, or a message.

Tolerance: three grey levels, one for each renderer's rounding and one for bytes in files.
"""

from __future__ import annotations

import logging
import math
import re
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import Image
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.ray_caster import commit_ray_caster, commit_to_reference
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from helpers.mesh_features import (
    FEATURES,
    SKY,
    Feature,
    Gltf,
    Point,
    light,
    pbr,
    png,
    quarters_with_alpha,
)

MAX_LEVELS = 3
CAMERA = PerspectiveCamera(96, 96, math.radians(70.0))
HEIGHT_M = 2.5
ABOVE = Pose.from_rpy((0.0, 0.0, -HEIGHT_M), (0.0, -0.5 * math.pi, 0.0))


def write_world(folder: Path, mesh: Path, row: Feature) -> Path:
    r, g, b = SKY
    path = folder / "world.ini"
    path.write_text(
        f"[Catoptra.World]\nAmbientOcclusion=off\nBackground=(R={r:g},G={g:g},B={b:g})\n"
        f'Lights={row.lights}\nMeshes=(Name="m",File="{mesh}",{row.options})\n'
    )
    return path


def draw(
    device: GlDevice, path: Path, *, has_shadows: bool = False, only: str = "", frames: int = 1
) -> dict[str, Image]:
    """Last picture from above by each renderer, or by one."""
    world, _ = read_world(path)
    scene = build_scene(world)
    state = CameraState(ABOVE, has_shadows=has_shadows)
    trace = TraceRenderer(scene, world, threads=1)
    raster = RasterRenderer(scene, world, device=device)
    try:
        views = {
            name: renderer.prepare_perspective(CAMERA, 2)
            for name, renderer in (("trace", trace), ("raster", raster))
            if only in (name, "")
        }
        return {
            name: [view.render(state).rgb for _ in range(frames)][-1]
            for name, view in views.items()
        }
    finally:
        trace.close()


def pixel_of(point: Point) -> tuple[int, int]:
    """Row and column of a point of the square, in a file whose z is up."""
    x, y = point
    offset = np.array([x, -y, HEIGHT_M])
    direction = ABOVE.inverse().rotate_directions(offset / np.linalg.norm(offset))
    pixel, seen = CAMERA.pixel_from_direction(direction)
    assert seen
    column, row = np.floor(pixel).astype(int).tolist()
    return row, column


@pytest.mark.parametrize("row", FEATURES, ids=lambda row: row.name)
def test_file_has_the_colours_that_its_format_demands_or_a_message(
    device: GlDevice, tmp_path: Path, caplog: pytest.LogCaptureFixture, row: Feature
) -> None:
    path = write_world(tmp_path, row.write(tmp_path), row)
    if row.rejection:
        with pytest.raises(ConfigError, match=row.rejection) as error:
            draw(device, path)
        assert "\n" not in str(error.value)
        return
    with caplog.at_level(logging.WARNING, logger="catoptra_server"):
        pictures = draw(device, path)
    if row.message:
        assert re.search(row.message, caplog.text)
    wrong = {
        (name, point): (picture[pixel_of(point)].tolist(), [round(value) for value in colour])
        for name, picture in pictures.items()
        for point, colour in row.colours.items()
        if np.abs(picture[pixel_of(point)] - np.array(colour)).max() > MAX_LEVELS
    }
    assert not wrong


def test_light_passes_holes_and_is_stopped_beside_them(device: GlDevice, tmp_path: Path) -> None:
    image = png(quarters_with_alpha(0))
    document = Gltf(**pbr(texture=0, alphaMode="MASK")).texture(image).square(0.0, pbr(1, 1, 1))
    mask, floor = document.json["meshes"][0]["primitives"]
    document.json["meshes"] = [{"primitives": [mask]}, {"primitives": [floor]}]
    high = {"mesh": 0, "translation": [0, 0, 0.5], "scale": [0.5, 0.5, 1]}
    document.json["nodes"] = [high, {"mesh": 1, "scale": [2, 2, 1]}]
    document.json["scenes"] = [{"nodes": [0, 1]}]
    # By the slope of the light the shadow is a metre to the right of what casts it.
    sun = "(Type=Directional,Direction=(X=2,Y=0,Z=1),Colour=(R=255,G=255,B=255))"
    row = Feature("shadow", document.write, lights=sun)
    path = write_world(tmp_path, document.write(tmp_path), row)
    for picture in draw(device, path, has_shadows=True).values():
        lit, dark, free = (picture[pixel_of((x, 0.1))] for x in (0.8, 1.25, -1.2))
        assert np.abs(lit - np.array(light(5**-0.5))).max() <= MAX_LEVELS
        assert dark.tolist() == [0, 0, 0]
        assert (lit == free).all()


@pytest.mark.parametrize(("opacity", "is_surface"), [(0.5, True), (0.49, False)])
def test_what_blends_casts_shadows_and_has_a_range_from_half_of_the_opacity(
    device: GlDevice, tmp_path: Path, opacity: float, is_surface: bool
) -> None:
    high = {"mesh": 0, "translation": [0, 0, 0.5], "scale": [0.5, 0.5, 1]}
    document = Gltf(**pbr(1, 1, 1, opacity, alphaMode="BLEND")).square(0.0, pbr(1, 1, 1))
    glass, floor = document.json["meshes"][0]["primitives"]
    document.json["meshes"] = [{"primitives": [glass]}, {"primitives": [floor]}]
    document.json["nodes"] = [high, {"mesh": 1, "scale": [2, 2, 1]}]
    document.json["scenes"] = [{"nodes": [0, 1]}]
    sun = "(Type=Directional,Direction=(X=2,Y=0,Z=1),Colour=(R=255,G=255,B=255))"
    path = write_world(tmp_path, document.write(tmp_path), Feature("", document.write, lights=sun))
    world, _ = read_world(path)
    expected = light(0.0 if is_surface else 5**-0.5)
    for picture in draw(device, path, has_shadows=True).values():
        for x in (0.8, 1.0, 1.2):
            assert np.abs(picture[pixel_of((x, 0.1))] - np.array(expected)).max() <= MAX_LEVELS
    above, down = np.array([[0.1, 0.05, -2.5]]), np.array([[0.0, 0.0, 1.0]])
    for commit in (commit_ray_caster, commit_to_reference):
        distance = commit(build_scene(world)).distances(above, down)
        assert distance == pytest.approx(2.0 if is_surface else 2.5, abs=1e-5)


@pytest.mark.parametrize(("name", "is_reported"), [("ten layers", True), ("eight layers", False)])
@pytest.mark.parametrize("renderer", ["trace", "raster"])
def test_layers_that_are_not_drawn_are_reported_once(
    device: GlDevice,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    name: str,
    is_reported: bool,
    renderer: str,
) -> None:
    (row,) = (row for row in FEATURES if f"BLEND of {name}" in row.name)
    path = write_world(tmp_path, row.write(tmp_path), row)
    draw(device, path, only=renderer, frames=2)
    drawn = "more than 8 surfaces that blend lie behind one another: the nearest 8 are drawn"
    assert caplog.text.count(drawn) == is_reported


def test_features_are_many_and_their_names_differ() -> None:
    names = [row.name for row in FEATURES]
    assert len(set(names)) == len(names) >= 70
