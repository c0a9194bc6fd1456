"""The robot in its own mirror, as both renderers show it: extent, camera and occlusion."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.robot_file import read_robot
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.simulation.robot_bodies import (
    CAMERA_RADIUS_M,
    OmniCameraTower,
    build_carrier_mesh,
    build_ego_body_mesh,
)
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, World
from helpers.dynamic_objects import P2AT
from helpers.image_comparison import level_differences
from helpers.opengl import device_or_skip
from helpers.renderers import RendererFactory
from helpers.worlds import HEMISPHERE_LIGHT, make_omni_camera, make_plan, make_test_world

MIRROR = Pose.from_rpy((0.0, 0.0, -0.4543))
# On the floor of the test room, where no object lies between mirror and robot.
BASE = Pose.from_rpy((0.4, -0.1, -0.1457), (0.0, 0.0, 0.7))
WHITE = World("empty", (), lights=(HEMISPHERE_LIGHT,), background=(1.0, 1.0, 1.0))


LIVE_ROBOT = read_robot(find_configuration("robots", "p2at_omni_live"))[0]


def camera_state_of(
    camera: OmniCamera, mirror: Pose = MIRROR, *, is_plain: bool = True
) -> CameraState:
    """State of a camera whose robot is in view."""
    if is_plain:
        mesh = build_ego_body_mesh(P2AT, OmniCameraTower(camera, mirror))
    else:
        omni = replace(LIVE_ROBOT.omni_cameras[0], camera=camera, robot_from_mirror=mirror)
        mesh = build_carrier_mesh(replace(LIVE_ROBOT, omni_cameras=(omni,)))
    body = DynamicObject(mesh, BASE)
    return CameraState(BASE @ mirror, objects=(body,), ego_body=body)


@pytest.mark.parametrize("is_plain", [True, False])
@pytest.mark.parametrize(
    "mirror",
    [MIRROR, Pose.from_rpy((0.1, -0.05, -0.6)), Pose.from_rpy((0.0, 0.0, -0.4543), (0.2, -0.1, 0))],
)
def test_body_is_visible_exactly_up_to_its_bound(
    make_renderer: RendererFactory, mirror: Pose, is_plain: bool
) -> None:
    camera = make_omni_camera(width_px=400)
    state = camera_state_of(camera, mirror, is_plain=is_plain)
    view = make_renderer(WHITE)
    image = view.prepare(camera, make_plan(camera)).render(state).rgb
    directions, on_mirror = direction_from_pixel(camera, pixel_sample_positions(camera))
    is_body = (image[..., 0] < 255) & on_mirror[..., 0]
    theta = np.arccos(directions[..., 2])[is_body]
    summary = SceneSummarizer(build_scene(WHITE), WHITE).summarize(state, camera)
    # A pixel shows its centre; one takes 0.7 degrees here.
    assert -0.02 < theta.max() - summary.ego_body_max_angle_rad <= 0.005


def test_camera_is_a_disc_in_the_image_centre(make_renderer: RendererFactory) -> None:
    camera = make_omni_camera(width_px=400)
    view = make_renderer(WHITE).prepare(camera, make_plan(camera))
    image = view.render(camera_state_of(camera)).rgb[..., 0].astype(int)
    row = image[200, 200:]
    deck = row[15]
    edge = int(np.flatnonzero(row == deck)[0])
    angle = math.atan(CAMERA_RADIUS_M / (0.2321 + 0.003))
    expected = camera.horizon_radius_px * float(
        camera.projection.radius_ratio_from_t(np.array(math.tan(0.5 * angle)))
    )
    assert edge == pytest.approx(expected, abs=1.5)


@pytest.mark.parametrize("is_plain", [True, False])
def test_renderers_agree_on_a_robot_in_its_own_mirror(is_plain: bool) -> None:
    world, camera = make_test_world(), make_omni_camera(width_px=300)
    state = camera_state_of(camera, is_plain=is_plain)
    plan = make_plan(camera, face_size_px=640)
    scene, device = build_scene(world), device_or_skip()
    trace, raster = TraceRenderer(scene, world), RasterRenderer(scene, world, device=device)
    traced, rastered = (r.prepare(camera, plan).render(state).rgb for r in (trace, raster))
    difference = level_differences(traced, rastered)
    trace.close()
    device.close()
    # Edges are off by half a texel: see test_agreement.py.
    assert (difference > 2).mean() < 0.03
    inner = difference[120:180, 120:180]
    assert (inner > 2).mean() < 0.1


def test_body_behind_an_object_is_hidden(make_renderer: RendererFactory) -> None:
    camera = make_omni_camera(width_px=200)
    plate = Item(
        "plate",
        Box((0.1, 0.1, 0.01)),
        BASE @ Pose.from_rpy((0.12, 0.08, -0.3)),
        Material((0.0, 1.0, 0.0), unlit=True),
    )
    world = World("plate", (plate,), lights=(HEMISPHERE_LIGHT,), background=(1.0, 1.0, 1.0))
    view = make_renderer(world).prepare(camera, make_plan(camera))
    image = view.render(camera_state_of(camera)).rgb
    for towards, is_plate in (((0.12, 0.08), True), ((-0.12, -0.08), False)):
        direction = np.array((*towards, -0.3 - MIRROR.translation[2]))
        u, v = pixel_from_direction(camera, direction)[0].astype(int)
        assert (image[v, u].tolist() == [0, 255, 0]) is is_plate
