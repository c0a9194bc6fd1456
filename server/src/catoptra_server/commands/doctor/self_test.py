"""Checks that load the server's libraries: configuration files, and the self-test of a renderer.

Each file is read as by the server, meshes and textures included. The self-test draws bright discs
with a renderer that is chosen and prepared as in the server; their largest displacement from the
camera model must be within the error bound of the plan itself.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    camera_with_inscribed_rim,
    pixel_from_direction,
)
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.commands.doctor.machine import Finding, fault, ok, warning
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.robot_file import read_robots
from catoptra_server.config.world_file import read_world
from catoptra_server.frames.plan.error_bound import error_bound
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.frames.renderers import choose_renderer
from catoptra_server.render.renderer import Image, PerPixel, RenderSettings
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Item, Material, Ring, World, linear_from_srgb

# The paper's mirror (K, C in metres) at the paper's resolution, with the rim at 120 degrees.
_CAMERA = camera_with_inscribed_rim(
    PAPER_MIRROR, width_px=360, height_px=360, rim_rad=math.radians(120.0)
)
# A disc of 1.2 degrees has 8 texels across a face of 768: the bound holds for markers of that size.
_RENDER_SETTINGS = RenderSettings(PerPixel(), samples=4, face_size_px=768, face_samples=4)
_INCIDENCES_DEG = (20.0, 40.0, 60.0, 80.0, 100.0, 115.0)
# Off the centres and borders of faces, where an exchanged axis or face would go unnoticed.
_BEARINGS_DEG = (3.0, 48.0, 93.0, 138.0, 183.0, 228.0, 273.0, 318.0)
_DISTANCE_M = 2.0
_DIAMETER_RAD = math.radians(1.2)
# A disc's radius is 2 px at most, the bound below 1 px; the neighbouring discs are farther away.
_SEARCH_RADIUS_PX = 5.0


def check_configurations(robots: Iterable[Path], worlds: Iterable[Path]) -> Iterator[Finding]:
    """Yield the findings of each file: an error, or the content and the unknown keys."""
    for path in robots:
        yield from _check_file("robot", path, _read_robot_names)
    for path in worlds:
        yield from _check_file("world", path, _read_world_summary)


def _check_file(
    kind: str, path: Path, read: Callable[[Path], tuple[str, IniFile]]
) -> Iterator[Finding]:
    topic = f"{kind} {path.stem}"
    losses = _Messages(logging.WARNING)
    scenes = logging.getLogger("catoptra_server.world")
    scenes.addHandler(losses)
    try:
        summary, file = read(path)
    except CatoptraError as error:
        remedy = "correct that line; configs/README.md lists the values of each key"
        yield fault(topic, str(error), remedy=remedy)
        return
    finally:
        scenes.removeHandler(losses)
    yield ok(topic, summary)
    for message in losses.texts:
        yield warning(topic, message, remedy="change the file, or accept the picture")
    # A warning outside our sections: real files carry keys of the engine, and the server starts.
    for name in file.unknown_names():
        message, remedy = f"{name.where}: {name.describe()}", "correct its spelling, or remove it"
        finding = fault if name.is_error else warning
        yield finding(topic, message, remedy=remedy)


class _Messages(logging.Handler):
    """Texts of log messages, such as what a mesh file says and no renderer draws."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a message's text."""
        self.texts.append(record.getMessage())


def _read_robot_names(path: Path) -> tuple[str, IniFile]:
    robots, file = read_robots(path)
    return ", ".join(robot.class_name for robot in robots), file


def _read_world_summary(path: Path) -> tuple[str, IniFile]:
    world, file = read_world(path)
    # Only the scene loads meshes and textures, where most errors of a world file are.
    return f"{world.name}, {len(build_scene(world))} triangles", file


def run_self_test(renderer: str) -> dict[str, Any]:
    """Render the discs with `trace` or `raster`, and measure their displacement.

    Returns:
        The renderer's description, error_px, bound_px and duration_s, for JSON.

    Raises:
        RendererUnavailableError: if the renderer cannot run on this machine.
    """
    begin_s = time.perf_counter()
    directions = _disc_directions()
    world = _disc_world(directions)
    choice = choose_renderer(renderer, build_scene(world), world)
    plan = plan_from_settings(_RENDER_SETTINGS, _CAMERA, kind=choice.kind, reason="self-test")
    view = choice.renderer.prepare(_CAMERA, plan)
    rgb = view.render(CameraState(Pose.identity())).rgb
    # With the renderer's set-up, which is most of the time where drivers compile shaders.
    duration_s = time.perf_counter() - begin_s
    values = {
        "renderer": choice.renderer.describe(),
        "error_px": _max_error_px(rgb, _CAMERA, directions),
        "bound_px": error_bound(_CAMERA, plan).marker_error_px,
        "duration_s": duration_s,
    }
    view.close()
    choice.renderer.close()
    return values


def _max_error_px(rgb: Image, camera: OmniCamera, directions: Floats) -> float:
    """Largest displacement of a disc in the frame; infinite if a disc is not visible.

    Args:
        rgb: (h, w, 3), sRGB bytes.
        camera: the camera model.
        directions: (n, 3) unit vectors of the discs' centres, mirror frame.
    """
    pixels, _ = pixel_from_direction(camera, directions)
    return max(float(np.hypot(*(_centroid(rgb, pixel) - pixel))) for pixel in pixels)


def _centroid(rgb: Image, pixel: Floats) -> Floats:
    """Centroid (2,) of the light around a pixel (2,); infinite where the frame is dark."""
    first = np.maximum(np.floor(pixel - _SEARCH_RADIUS_PX).astype(int), 0)
    last = np.ceil(pixel + _SEARCH_RADIUS_PX).astype(int)
    window = rgb[first[1] : last[1], first[0] : last[0]]
    # Weighted by linear light: sRGB bytes would overstate the dim pixels of a disc's border.
    light = linear_from_srgb(window / 255.0).sum(axis=-1)
    if not light.any():
        return np.full(2, np.inf)
    v, u = np.indices(light.shape) + 0.5
    in_window = np.array(((u * light).sum(), (v * light).sum())) / light.sum()
    centroid: Floats = np.asarray(in_window + first, np.float64)
    return centroid


def _disc_directions() -> Floats:
    theta, gamma = np.radians(np.meshgrid(_INCIDENCES_DEG, _BEARINGS_DEG)).reshape(2, -1)
    ring = np.sin(theta)
    return np.stack((ring * np.cos(gamma), ring * np.sin(gamma), np.cos(theta)), axis=-1)


def _disc_world(directions: Floats) -> World:
    """Black world with a white, unlit disc that faces the viewpoint in each direction."""
    disc = Ring(0.0, _DISTANCE_M * math.tan(0.5 * _DIAMETER_RAD), sectors=48)
    white = Material((1.0, 1.0, 1.0), unlit=True)
    items = tuple(Item(f"disc {n}", disc, _pose_facing(d), white) for n, d in enumerate(directions))
    return World("self-test", items)


def _pose_facing(direction: Floats) -> Pose:
    """Pose of a disc whose normal points back along a direction (3,)."""
    # The axis least parallel to the direction: the cross product stays away from zero.
    x = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    x /= np.linalg.norm(x)
    rotation = np.stack((x, np.cross(direction, x), direction), axis=-1)
    return Pose(rotation, _DISTANCE_M * direction)
