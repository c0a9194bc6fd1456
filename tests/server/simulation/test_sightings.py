"""Which landmarks are seen, in rooms and behind boxes of exact geometry."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.camera import camera_with_rim_inscribed, direction_from_pixel
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_server.imaging.shot import Eye, OmniEye, Take
from catoptra_server.render.renderer import Exposure
from catoptra_server.render.trace.ray_caster import EmbreeRayCaster
from catoptra_server.robot.render_wish import RenderWish
from catoptra_server.scene.description import World
from catoptra_server.scene.landmark_shapes import items_from_landmark
from catoptra_server.scene.meshes import build_scene
from catoptra_server.scene.oriented_box import OrientedBox
from catoptra_server.sensors.sight import EMPTY, Nothing, Surroundings
from catoptra_server.simulation.sightings import Sighting, sightings

BEACON = Landmark("b", "beacon", 2.0, 0.0, 0.1, 0.0, 0.2, 0.4, "cyan", "yellow")
GOAL = Landmark("g", "goal", 2.7, 0.0, 0.8, 0.3, 0.0, 0.3, "cyan", "cyan")
GREY = {"cyan": (0.5, 0.5, 0.5), "yellow": (0.5, 0.5, 0.5)}
OMNI = OmniEye(
    camera_with_rim_inscribed(
        HyperbolicMirror(11.546, 0.2321), width_px=200, height_px=200, rim_rad=math.radians(120.0)
    ),
    RenderWish(),
)
FLAT = PerspectiveCamera(320, 240, 1.2)
HEIGHT_M = 0.5


def look(
    eye: Eye,
    landmark: Landmark,
    *,
    around: Surroundings = EMPTY,
    x_m: float = 0.0,
    yaw_rad: float = 0.0,
) -> Sighting:
    """Return what an eye 0.5 m over the floor sees of one landmark."""
    pose = Pose.from_rpy((x_m, 0.0, -HEIGHT_M), (0.0, 0.0, yaw_rad))
    (found,) = sightings(Take(eye, Exposure(pose)), [landmark], around)
    return found


def scene_of(landmark: Landmark) -> Surroundings:
    """Return a scene of nothing but the landmark itself, as it is drawn."""
    world = World("field", items_from_landmark(landmark, GREY))
    return Surroundings(EmbreeRayCaster(build_scene(world)))


def test_pixel_when_of_a_flat_camera_is_where_its_law_puts_the_band() -> None:
    found = look(FLAT, BEACON)
    focal_px = 160.0 / math.tan(0.6)
    assert found.pixel == pytest.approx((160.0, 120.0 + focal_px * 0.2 / 2.0))
    assert found.visible


def test_pixel_when_of_an_omnidirectional_camera_looks_back_at_the_band() -> None:
    found = look(OMNI, BEACON, yaw_rad=2.0)
    assert found.pixel is not None
    ray, valid = direction_from_pixel(OMNI.camera, np.array(found.pixel))
    assert valid
    ahead = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, 2.0)).directions(ray)
    assert ahead == pytest.approx(np.array((2.0, 0.0, 0.2)) / math.hypot(2.0, 0.2))


@pytest.mark.parametrize("yaw_rad", [math.pi, 0.7, -0.7])
def test_landmark_when_beside_a_flat_picture_has_no_pixel(yaw_rad: float) -> None:
    assert look(FLAT, BEACON, yaw_rad=yaw_rad) == Sighting(BEACON, None, False)


@pytest.mark.parametrize(("box_x_m", "visible"), [(1.0, False), (1.5, False), (3.0, True)])
def test_landmark_when_a_robot_stands_before_it_is_hidden(box_x_m: float, visible: bool) -> None:
    box = OrientedBox(Pose.from_rpy((box_x_m, 0.0, -0.4)), (0.3, 0.3, 0.8))
    found = look(FLAT, BEACON, around=Surroundings(Nothing(), (box,)))
    assert found.pixel is not None
    assert found.visible is visible


@pytest.mark.parametrize(
    ("x_m", "width_m"), [(0.0, 0.1), (1.5, 0.1), (1.949, 0.1), (0.0, 0.5), (1.749, 0.5)]
)
def test_beacon_when_only_its_own_surface_is_before_its_middle_is_seen(
    x_m: float, width_m: float
) -> None:
    beacon = dataclasses.replace(BEACON, width_m=width_m)
    assert look(OMNI, beacon, around=scene_of(beacon), x_m=x_m).visible


@pytest.mark.parametrize(("x_m", "visible"), [(0.0, True), (3.5, False)])
def test_goal_when_looked_at_from_behind_is_hidden_by_its_own_back(
    x_m: float, visible: bool
) -> None:
    low = dataclasses.replace(GOAL, band_top_m=0.6)
    assert look(OMNI, low, around=scene_of(low), x_m=x_m).visible is visible


def test_landmarks_when_there_are_none_are_none() -> None:
    assert sightings(Take(FLAT, Exposure(Pose.identity())), [], EMPTY) == ()
