"""Sensors and cameras of a chassis on a ramp, on its side, on its back: against plain geometry."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.frames.image_port import mounted_camera_state
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.ray_caster import commit_ray_caster
from catoptra_server.simulation.robot_description import Mount
from catoptra_server.simulation.sensors import (
    EMPTY_ENVIRONMENT,
    EmptyScene,
    SensorContext,
    SensorEnvironment,
)
from catoptra_server.simulation.sight import compute_landmark_visibility
from catoptra_server.world.objects import OrientedBox
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    Box,
    GpsOrigin,
    Item,
    Material,
    Rectangle,
    RfidTag,
    Victim,
    World,
)
from helpers.markers import marker_centroid, marker_directions, marker_world
from helpers.robots import (
    BASE,
    FORWARD_MOUNT,
    GPS,
    GROUND_TRUTH,
    INS,
    RFID,
    SCANNER,
    SONAR,
    VICTIMS,
    make_instrument,
)
from helpers.worlds import make_omni_camera, make_plan

# On a slope, on its side, on its back.
ATTITUDES = [(0.12, 0.31, -2.2), (-1.5, 0.1, 0.7), (math.pi - 0.05, -0.2, 2.9)]
PLACE_M = np.array((1.5, -2.0, -1.3))


def turn_about(axis: int, angle_rad: float) -> Floats:
    """(3, 3) rotation about x, y or z."""
    rotation, (i, j) = np.eye(3), ((1, 2), (2, 0), (0, 1))[axis]
    rotation[[i, j], [i, j]] = math.cos(angle_rad)
    rotation[i, j], rotation[j, i] = -math.sin(angle_rad), math.sin(angle_rad)
    return rotation


def turn_by(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Floats:
    """(3, 3) rotation by angles as on the wire."""
    return turn_about(2, yaw_rad) @ turn_about(1, pitch_rad) @ turn_about(0, roll_rad)


def stand(rotation: Floats, environment: SensorEnvironment) -> SensorContext:
    return SensorContext(1.0, 0, Pose(rotation, PLACE_M.copy()), environment)


def scan_points(context: SensorContext, pitch_rad: float) -> Floats:
    """(n, 3) echoes in the world of a scanner that is mounted at an angle."""
    turn = turn_about(1, pitch_rad)
    mount = Mount(FORWARD_MOUNT.position_m, (0.0, pitch_rad, 0.0))
    ranges = np.array(make_instrument(replace(SCANNER, mount=mount)).read(context).ranges_m)
    angles = 0.5 * math.pi - math.pi / 180.0 * np.arange(len(ranges))
    beams = np.stack((np.cos(angles), np.sin(angles), 0.0 * angles), axis=-1)
    in_robot = (ranges[:, None] * beams) @ turn.T + FORWARD_MOUNT.position_m
    pose = context.world_from_robot
    points: Floats = in_robot @ pose.rotation.T + pose.translation
    return points[ranges < SCANNER.max_range_m]


GREY = Material((0.5, 0.5, 0.5))
RAMP = turn_by(0.08, 0.2, 0.0)


def test_ranges_of_two_poses_on_a_ramp_make_one_cloud() -> None:
    wall, foot = turn_about(2, 0.3), np.array((5.0, 0.0, -1.5))
    items = (
        Item("ramp", Rectangle((30.0, 30.0)), Pose(RAMP, np.zeros(3)), GREY),
        Item("wall", Box((0.2, 40.0, 40.0)), Pose(wall, foot), GREY),
    )
    around = SensorEnvironment(commit_ray_caster(build_scene(World("ramp", items))))
    planes = [
        (RAMP[:, 2], 0.0),
        *((wall[:, 0], foot @ wall[:, 0] + side) for side in (-0.1, 0.1)),
    ]
    for x_m, y_m, yaw_rad in ((1.0, 0.5, 0.4), (-1.0, -1.5, -0.5)):
        rotation = RAMP @ turn_about(2, yaw_rad)
        place = RAMP @ np.array((x_m, y_m, -BASE.ride_height_m))
        context = SensorContext(1.0, 0, Pose(rotation, place), around)
        level, down = scan_points(context, 0.0), scan_points(context, -0.3)
        errors = [
            np.abs(np.stack([points @ normal - offset for normal, offset in planes]))
            for points in (level, down)
        ]
        assert min(len(level), len(down)) > 40
        assert max(error.min(axis=0).max() for error in errors) < 1e-3
        # Along the ramp the level scanner never meets it; the other one does.
        assert (errors[0][0] > 0.1).all()
        assert (errors[1][0] < 1e-3).sum() > 40
        ((_, sonar_m),) = (
            make_instrument(replace(SONAR, num_cones=0, max_range_m=20.0)).read(context).items
        )
        mount = rotation @ FORWARD_MOUNT.position_m + place
        along = [(o - mount @ n) / (rotation[:, 0] @ n) for n, o in planes[1:]]
        assert sonar_m == pytest.approx(min(along), abs=1e-3)


@pytest.mark.parametrize("attitude", ATTITUDES)
def test_tilted_robot_is_seen_as_a_tilted_box(attitude: tuple[float, float, float]) -> None:
    box = OrientedBox(
        Pose(turn_by(*attitude), PLACE_M + np.array((0.9, 0.1, 0.0))), (0.5, 0.4, 0.3)
    )
    points = scan_points(stand(np.eye(3), SensorEnvironment(EmptyScene(), (box,))), 0.0)
    in_box = (points - box.world_from_box.translation) @ box.world_from_box.rotation
    assert len(points) > 10
    assert np.abs(in_box / (0.25, 0.2, 0.15)).max(axis=1) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("attitude", ATTITUDES)
def test_poses_and_places_are_those_of_the_tilted_sensor(
    attitude: tuple[float, float, float],
) -> None:
    rotation = turn_by(*attitude)
    mount = PLACE_M + rotation @ FORWARD_MOUNT.position_m
    seen = mount + rotation @ (1.5, 0.2, -0.4)
    environment = SensorEnvironment(
        EmptyScene(),
        rfid_tags=tuple(
            RfidTag(n, tuple(mount + np.array((0, 0, d)))) for n, d in enumerate((1.99, 2.01))
        ),
        victims=(Victim("v", tuple(seen)), Victim("behind", tuple(2.0 * mount - seen))),
        gps_origin=GpsOrigin(0.0, 0.0),
    )
    context = stand(rotation, environment)
    ins, truth, gps, tags, victims = (
        make_instrument(each).read(context) for each in (INS, GROUND_TRUTH, GPS, RFID, VICTIMS)
    )
    assert ins.location_m == pytest.approx(mount)
    assert truth.location_m == pytest.approx(PLACE_M)
    assert turn_by(*ins.rotation_rad) == pytest.approx(rotation)
    assert truth.rotation_rad == pytest.approx(attitude)
    # Degrees of the equator: to the millimetre of the receiver's own place.
    metres = gps.latitude_deg * 110_574.27, gps.longitude_deg * 111_319.49
    assert metres == pytest.approx(mount[:2], abs=1e-3)
    assert tags.ids == (0,)
    assert [part.name for part in victims.parts] == ["v"]
    assert victims.parts[0].location_m == pytest.approx((1.5, 0.2, -0.4))


def test_robot_on_its_back_reports_a_roll_of_half_a_turn() -> None:
    context = stand(turn_by(math.pi, 0.0, 0.5), EMPTY_ENVIRONMENT)
    truth = make_instrument(replace(GROUND_TRUTH, decimals=2)).read(context)
    assert b"{Orientation 3.14,0.00,0.50}" in line_from_report(truth)


def cone_centroid(camera: OmniCamera, axis: Floats, half_angle_rad: float, near: Floats) -> Floats:
    """(2,) centroid of the pixels whose directions lie in a cone, by 20 x 20 points each."""
    steps = (np.arange(600) - 299.5) / 20.0
    points = np.stack(np.meshgrid(steps, steps), axis=-1) + np.floor(near)
    directions, seen = direction_from_pixel(camera, points)
    centroid: Floats = points[seen & (directions @ axis > math.cos(half_angle_rad))].mean(axis=0)
    return centroid


def test_landmarks_are_drawn_and_found_where_the_tilted_pose_projects_them() -> None:
    camera, size_rad = make_omni_camera(width_px=400), math.radians(5.0)
    mount = Pose(turn_by(0.02, -0.03, 0.0), np.array((0.1, 0.02, -0.45)))
    directions = marker_directions((30.0, 65.0, 100.0), (10.0, 100.0, -140.0, -50.0))
    centres, _ = pixel_from_direction(camera, directions)
    expected = np.array(
        [
            cone_centroid(camera, axis, 0.5 * size_rad, at)
            for axis, at in zip(directions, centres, strict=True)
        ]
    )
    for attitude in ATTITUDES:
        rotation = turn_by(*attitude)
        mirror = Pose(rotation @ mount.rotation, PLACE_M + rotation @ mount.translation)
        state = mounted_camera_state(Pose(rotation, PLACE_M.copy()), mount)
        world = marker_world(directions, world_from_mirror=mirror, diameter_rad=size_rad)
        renderer = TraceRenderer(build_scene(world), world, threads=2)
        image = renderer.prepare(camera, make_plan(camera, samples=8)).render(state).rgb
        renderer.close()
        drawn = np.array([marker_centroid(image, at, window_px=15.0) for at in centres])
        assert np.linalg.norm(drawn - expected, axis=1).max() < 0.02
        # Landmarks whose bands are a centimetre about the discs' centres.
        places = 2.0 * directions @ mirror.rotation.T + mirror.translation
        marks = [
            Landmark(f"l{number}", "beacon", x, y, 0.01, 0.0, -z - 0.005, -z + 0.005, "red", "red")
            for number, (x, y, z) in enumerate(places.tolist())
        ]
        spec, pose = OmniCameraSpec(camera, RenderSettings()), state.world_from_mirror
        found = compute_landmark_visibility(spec, pose, marks, EMPTY_ENVIRONMENT)
        assert np.array([one.pixel for one in found]) == pytest.approx(centres, abs=1e-6)
