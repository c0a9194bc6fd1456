"""The self-test: a frame of bright discs, and how far they appear from where the law puts them.

The renderer that draws it is the server's own, chosen as the server would. What is measured is held
against the bound of the frame's plan.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    camera_with_inscribed_rim,
    pixel_from_direction,
)
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.planning.error_bound import error_bound
from catoptra_server.planning.renderer_choice import choose_renderer
from catoptra_server.render.render_plan import PerPixel, RenderSettings, plan_from_settings
from catoptra_server.render.renderer import Image
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.world_description import Item, Material, Ring, World

# The paper's mirror (K, C in metres) in a picture of its size; its rim at 120 degrees.
_CAMERA = camera_with_inscribed_rim(
    HyperbolicMirror(11.546, 0.2321), width_px=360, height_px=360, rim_rad=math.radians(120.0)
)
# A disc is 8 texels wide at least: of smaller things faces promise nothing.
_RENDER_SETTINGS = RenderSettings(PerPixel(), samples=4, face_size_px=768, face_samples=4)
_INCIDENCES_DEG = (20.0, 40.0, 60.0, 80.0, 100.0, 115.0)
# Off the faces' middles and borders, and off each other's symmetry.
_BEARINGS_DEG = (3.0, 48.0, 93.0, 138.0, 183.0, 228.0, 273.0, 318.0)
_DISTANCE_M = 2.0
_DIAMETER_RAD = math.radians(1.2)
_SEARCH_RADIUS_PX = 5.0


def run_self_test(renderer: str) -> dict[str, Any]:
    """Draw by `trace` or `raster`; return who drew, the largest error, its bound, and the time.

    Raises RendererUnavailableError where it cannot run.
    """
    begin_s = time.perf_counter()
    directions = _disc_directions()
    world = _disc_world(directions)
    choice = choose_renderer(renderer, build_scene(world), world)
    plan = plan_from_settings(_RENDER_SETTINGS, _CAMERA, kind=choice.kind, reason="self-test")
    view = choice.renderer.prepare(_CAMERA, plan)
    rgb = view.render(CameraState(Pose.identity())).rgb
    took_s = time.perf_counter() - begin_s
    facts = {
        "renderer": choice.renderer.describe(),
        "error_px": max_error_px(rgb, _CAMERA, directions),
        "bound_px": error_bound(_CAMERA, plan).marker_error_px,
        "took_s": took_s,
    }
    view.close()
    choice.renderer.close()
    return facts


def max_error_px(rgb: Image, camera: OmniCamera, directions: Floats) -> float:
    """Return how far off the worst of the discs is; infinite if one of them is not to be seen.

    rgb: (h, w, 3). directions: (n, 3) unit, in the mirror frame.
    """
    places, _ = pixel_from_direction(camera, directions)
    return max(float(np.hypot(*(_centroid(rgb, place) - place))) for place in places)


def _centroid(rgb: Image, pixel: Floats) -> Floats:
    """Return the (2,) middle of the light around a (2,) place; infinite where it is dark."""
    first = np.maximum(np.floor(pixel - _SEARCH_RADIUS_PX).astype(int), 0)
    last = np.ceil(pixel + _SEARCH_RADIUS_PX).astype(int)
    window = rgb[first[1] : last[1], first[0] : last[0]]
    light = linear_from_srgb(window / 255.0).sum(axis=-1)
    if not light.any():
        return np.full(2, np.inf)
    v, u = np.indices(light.shape) + 0.5
    middle = np.array(((u * light).sum(), (v * light).sum())) / light.sum()
    centroid: Floats = np.asarray(middle + first, np.float64)
    return centroid


def _disc_directions() -> Floats:
    theta, gamma = np.radians(np.meshgrid(_INCIDENCES_DEG, _BEARINGS_DEG)).reshape(2, -1)
    ring = np.sin(theta)
    return np.stack((ring * np.cos(gamma), ring * np.sin(gamma), np.cos(theta)), axis=-1)


def _disc_world(directions: Floats) -> World:
    """Return a black world with a white, unlit disc facing the viewpoint in each direction."""
    disc = Ring(0.0, _DISTANCE_M * math.tan(0.5 * _DIAMETER_RAD), sectors=48)
    white = Material((1.0, 1.0, 1.0), unlit=True)
    items = tuple(Item(f"disc {n}", disc, _pose_facing(d), white) for n, d in enumerate(directions))
    return World("self-test", items)


def _pose_facing(direction: Floats) -> Pose:
    """Return the pose of a disc that looks back along a (3,) direction."""
    x = np.cross(np.eye(3)[np.argmin(np.abs(direction))], direction)
    x /= np.linalg.norm(x)
    rotation = np.stack((x, np.cross(direction, x), direction), axis=-1)
    return Pose(rotation, _DISTANCE_M * direction)
