"""Bases on planes, steps, edges, decks and each other; falls; what stops them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.drive import STANDARD_BASES, RobotBody, WheelSpin, step_body
from catoptra_server.simulation.ground import REST_DEPTH_M, NoStandError, SceneGround
from catoptra_server.simulation.robot_description import DriveBase, PlanarPose
from catoptra_server.world.objects import OrientedBox
from catoptra_server.world.world_description import Box, Item, Material, Rectangle, World
from helpers.random_drives import NUM_WORLDS, Stage, drive_at_random, make_rough_world
from helpers.robots import make_ground

P2AT = STANDARD_BASES["p2at"]
TICK_S = 0.02
ORIGIN = PlanarPose(0.0, 0.0, 0.0)
FLOOR = ("floor", Rectangle((60.0, 60.0)), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
_Placed = tuple[str, Box | Rectangle, tuple[float, float, float], tuple[float, float, float]]


def ground_of(*items: _Placed) -> SceneGround:
    grey = Material((0.5, 0.5, 0.5))
    placed = (Item(name, shape, Pose.from_rpy(xyz, rpy), grey) for name, shape, xyz, rpy in items)
    return make_ground(World("ground", tuple(placed)))


def box(x: float, y: float, top: float, size: tuple[float, float, float]) -> _Placed:
    """Box whose upper side is at a height."""
    return ("box", Box(size), (x, y, -top + 0.5 * size[2]), (0.0, 0.0, 0.0))


def drive(
    ground: SceneGround,
    body: RobotBody,
    seconds: float,
    left: float = 3.0,
    right: float = 3.0,
    others: Sequence[OrientedBox] = (),
) -> list[RobotBody]:
    """Base after each tick."""
    slip, bodies = RandomSource.from_names(1, "slip"), []
    body = replace(body, spin=WheelSpin(left, right))
    for _ in range(round(seconds / TICK_S)):
        body, _ = step_body(
            body,
            TICK_S,
            move=lambda *args: ground.move(*args, others=others),
            random_source=slip,
        )
        bodies.append(body)
    return bodies


def height(body: RobotBody) -> float:
    """Of the chassis above the plane of level wheels, metres."""
    return -float(body.world_from_robot.translation[2]) - body.base.ride_height_m


def tilt_deg(body: RobotBody) -> float:
    return math.degrees(math.acos(min(1.0, float(body.world_from_robot.rotation[2, 2]))))


def plane_of(slope_rad: float) -> tuple[SceneGround, np.ndarray]:
    """Plane through (3, 2, -1) that rises along x, and its normal, upwards."""
    normal = np.array((-math.sin(slope_rad), 0.0, -math.cos(slope_rad)))
    plane = ("plane", Rectangle((4000.0, 4000.0)), (3.0, 2.0, -1.0), (0.0, slope_rad, 0.0))
    return ground_of(plane), normal


@pytest.mark.parametrize("slope_deg", [0.0, 5.0, 17.0, 30.0])
def test_base_anywhere_on_a_plane_stands_as_the_plane_does(slope_deg: float) -> None:
    ground, normal = plane_of(math.radians(slope_deg))
    rng = np.random.default_rng(7)
    for _ in range(12):
        x, y = rng.uniform(-1000.0, 1000.0, 2).tolist()
        z = -1.0 - math.tan(math.radians(slope_deg)) * (x - 3.0)
        body = ground.place(P2AT, PlanarPose(x, y, float(rng.uniform(-3.1, 3.1))), z - 0.3)
        up = -body.world_from_robot.rotation[:, 2]
        assert math.degrees(math.acos(min(1.0, float(up @ normal)))) < 0.2
        above_m = (body.world_from_robot.translation - (3.0, 2.0, -1.0)) @ normal
        assert above_m == pytest.approx(P2AT.ride_height_m, abs=2e-3)


@pytest.mark.parametrize("yaw_rad", [0.0, math.pi / 2.0, math.pi, 0.6])
def test_base_on_a_slope_drives_as_far_as_its_wheels(yaw_rad: float) -> None:
    ground, _ = plane_of(math.radians(25.0))
    start = ground.place(P2AT, PlanarPose(0.0, 0.0, yaw_rad), 0.0)
    end = drive(ground, start, 15.4, 5.0, 5.0)[-1]
    way = end.world_from_robot.translation - start.world_from_robot.translation
    # In the plane, along the projected heading, without sliding down.
    ahead = start.world_from_robot.rotation[:, 0]
    assert way @ ahead == pytest.approx(5.0 * 0.13 * 15.4, abs=0.01)
    assert np.linalg.norm(way - (way @ ahead) * ahead) < 0.01


def test_base_on_a_level_floor_moves_as_in_the_plane_to_the_last_bit() -> None:
    level, plane = ground_of(FLOOR, box(2.0, 0.0, 0.001, (0.5, 3.0, 0.001))), make_ground()
    body = RobotBody.on_floor(P2AT, ORIGIN)
    pairs = zip(drive(level, body, 6.0, 3.0, 2.5), drive(plane, body, 6.0, 3.0, 2.5), strict=True)
    # Over a painted line, too.
    for one, other in pairs:
        assert one.pose == other.pose
        np.testing.assert_array_equal(
            one.world_from_robot.translation, other.world_from_robot.translation
        )
        np.testing.assert_array_equal(
            one.world_from_robot.rotation, other.world_from_robot.rotation
        )


@pytest.mark.parametrize(("step_m", "is_climbed"), [(0.03, True), (0.06, True), (0.08, False)])
def test_step_is_climbed_up_to_half_a_wheel_s_radius(step_m: float, is_climbed: bool) -> None:
    ground = ground_of(FLOOR, box(2.5, 0.0, step_m, (3.0, 3.0, step_m)))
    body = drive(ground, RobotBody.on_floor(P2AT, ORIGIN), 5.0)[-1]
    assert height(body) == pytest.approx(step_m if is_climbed else 0.0, abs=1e-4)
    assert (body.pose.x_m > 1.9) == is_climbed
    lower = replace(P2AT, step_limit_m=0.01)
    assert drive(ground, RobotBody.on_floor(lower, ORIGIN), 5.0)[-1].pose.x_m < 1.0


def test_slope_is_climbed_up_to_the_largest_angle_but_driven_down() -> None:
    slope = math.radians(30.0)
    ramp = ("ramp", Box((4.0, 2.0, 0.05)), (2.0 + 2.0 * math.cos(slope), 0.0, -1.0), (0, slope, 0))
    ground = ground_of(FLOOR, ramp)
    able, unable = P2AT, replace(P2AT, max_climb_rad=math.radians(20.0))
    start = RobotBody.on_floor(P2AT, PlanarPose(1.0, 0.0, 0.0))
    up = drive(ground, start, 6.0)
    assert max(map(tilt_deg, up)) == pytest.approx(30.0, abs=0.2)
    stopped = drive(ground, replace(start, base=unable), 6.0)[-1]
    assert tilt_deg(stopped) == pytest.approx(20.0, abs=0.2)
    down = drive(ground, replace(stopped, base=able), 6.0, -3.0, -3.0)[-1]
    assert tilt_deg(down) == 0.0


def test_base_over_an_edge_falls_as_long_as_gravity_takes_and_lies_below() -> None:
    ground = ground_of(FLOOR, box(0.0, 0.0, 3.0, (3.0, 3.0, 0.1)))
    start = ground.place(P2AT, ORIGIN, -3.0)
    assert height(start) == pytest.approx(3.0)
    bodies = drive(ground, start, 8.0)
    heights = np.array(list(map(height, bodies)))
    # The free part of the fall: from 2.2 m, where no point touches the edge, to 0.7 m.
    first, last = int((heights < 2.2).argmax()), int((heights < 0.7).argmax())
    speeds = -np.diff(heights[first : last + 1]) / TICK_S
    assert np.diff(speeds) == pytest.approx(9.81 * TICK_S, abs=2e-3)
    assert height(bodies[-1]) < 0.5
    assert bodies[-1].is_settled


def test_base_upside_down_lies_still_until_it_is_flipped() -> None:
    ground = ground_of(FLOOR, box(0.0, 0.0, 2.5, (1.2, 1.2, 0.1)))
    # Slowly over an edge: it turns about the edge, and on in the air.
    fallen = drive(ground, ground.place(P2AT, ORIGIN, -2.5), 6.0, 1.5, 1.5)[-1]
    assert fallen.mishap == "has fallen, and lies on its roof"
    assert tilt_deg(fallen) == pytest.approx(180.0, abs=0.2)
    later = drive(ground, fallen, 2.0, 5.0, 5.0)[-1]
    assert later.world_from_robot is fallen.world_from_robot
    flipped = drive(ground, replace(later, is_flipping=True, is_settled=False), 0.04, 0.0, 0.0)[-1]
    assert (tilt_deg(flipped), height(flipped), flipped.mishap) == (0.0, 0.0, "")


def test_base_without_a_floor_below_rests_at_the_stated_depth() -> None:
    ground = ground_of(("island", Rectangle((2.0, 2.0)), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    body = drive(ground, RobotBody.on_floor(P2AT, ORIGIN), 0.02)[-1]
    body = drive(ground, ground.place(P2AT, ORIGIN, 0.0), 8.0)[-1]
    assert -float(body.world_from_robot.translation[2]) == pytest.approx(-REST_DEPTH_M, abs=0.6)
    assert "has nothing below" in body.mishap


def test_height_of_a_place_chooses_the_surface() -> None:
    ground = ground_of(
        FLOOR, box(0.0, 0.0, 1.0, (4.0, 4.0, 0.05)), box(0.0, 3.5, 1.0, (1.0, 1.0, 1.0))
    )
    at = [height(ground.place(P2AT, ORIGIN, z)) for z in (-2.9, -1.1, -0.9, 0.0, 0.7, -30.0)]
    # At or below it within 2 m, else the nearest above, else the next below.
    assert at == pytest.approx([1.0, 1.0, 0.0, 0.0, 0.0, 1.0], abs=1e-4)
    with pytest.raises(NoStandError, match=r"inside a solid|touches an obstacle"):
        ground.place(P2AT, PlanarPose(0.0, 3.5, 0.0), 0.0)
    with pytest.raises(NoStandError, match="there is no floor"):
        ground.place(P2AT, PlanarPose(100.0, 0.0, 0.0), 0.0)
    with pytest.raises(NoStandError, match="would fall"):
        plane_of(math.radians(50.0))[0].place(P2AT, ORIGIN, 0.0)


def test_table_that_lets_a_level_base_pass_stops_it_on_a_ramp() -> None:
    slope, room_m = math.radians(20.0), 0.32
    ramp = ("ramp", Box((6.0, 2.0, 0.05)), (3.0 * math.cos(slope), 0.0, -1.0), (0.0, slope, 0.0))
    start = RobotBody.on_floor(P2AT, PlanarPose(-1.5, 0.0, 0.0))
    for items, floor_m, passes in (
        ((FLOOR,), 0.0, True),
        # The upper side of the ramp at x = 2.5, by its plane.
        (
            (FLOOR, ramp),
            1.0 + 0.025 / math.cos(slope) + (2.5 - ramp[2][0]) * math.tan(slope),
            False,
        ),
    ):
        table = box(2.5, 0.0, floor_m + room_m + 0.03, (0.1, 2.0, 0.03))
        end = drive(ground_of(*items, table), start, 16.0)[-1]
        assert (end.pose.x_m > 3.0) == passes


def test_base_on_another_robot_falls_when_that_drives_away() -> None:
    ground, size = ground_of(FLOOR), (1.5, 1.5, 0.3)
    carrier = OrientedBox(Pose.from_rpy((0.0, 0.0, -0.15)), size)
    body = ground_of(FLOOR, box(0.0, 0.0, 0.3, size)).place(P2AT, ORIGIN, -0.5)
    body = drive(ground, replace(body, is_settled=False), 0.1, 0.0, 0.0, [carrier])[-1]
    assert height(body) == pytest.approx(0.3, abs=1e-4)
    assert not body.is_settled
    away = OrientedBox(Pose.from_rpy((3.0, 0.0, -0.15)), size)
    fallen = drive(ground, body, 1.0, 0.0, 0.0, [away])
    assert height(fallen[-1]) == pytest.approx(0.0, abs=1e-4)
    # 0.3 m take 0.247 s.
    assert sum(height(one) > 1e-3 for one in fallen) == pytest.approx(0.247 / TICK_S, abs=1.5)


def test_door_that_is_narrower_than_the_base_stops_it() -> None:
    for gap_m, passes in ((0.48, False), (0.52, True)):
        posts = [box(2.0, side * 0.5 * (gap_m + 1.0), 1.0, (0.1, 1.0, 1.0)) for side in (-1, 1)]
        body = drive(ground_of(FLOOR, *posts), RobotBody.on_floor(P2AT, ORIGIN), 8.0)[-1]
        assert (body.pose.x_m > 2.5) == passes


def test_two_bases_on_one_ramp_keep_apart() -> None:
    ground, _ = plane_of(math.radians(20.0))
    ahead = ground.place(P2AT, PlanarPose(1.5, 0.0, 0.0), 0.0)
    middle = Pose(np.eye(3), np.array((0.0, 0.0, P2AT.ride_height_m - 0.5 * 0.2913)))
    carrier = OrientedBox(ahead.world_from_robot @ middle, P2AT.collision_size_m)
    behind = ground.place(P2AT, PlanarPose(0.0, 0.0, 0.0), 0.0, others=[carrier])
    stopped = drive(ground, behind, 5.0, 5.0, 5.0, [carrier])[-1]
    apart = np.linalg.norm(
        stopped.world_from_robot.translation - ahead.world_from_robot.translation
    )
    assert apart == pytest.approx(P2AT.collision_size_m[0], abs=1e-3)


def test_triangles_without_area_and_needles_neither_stop_nor_carry() -> None:
    needle = ("needle", Box((3.0, 1e-6, 1e-6)), (1.5, 0.0, -0.02), (0.0, 0.0, 0.0))
    nothing = ("nothing", Rectangle((1e-30, 2.0)), (1.0, 0.0, -0.3), (0.0, 0.0, 0.0))
    body = drive(ground_of(FLOOR, needle, nothing), RobotBody.on_floor(P2AT, ORIGIN), 4.0)[-1]
    assert np.isfinite(body.world_from_robot.translation).all()
    assert body.pose.x_m > 0.6


@pytest.mark.parametrize("number", range(NUM_WORLDS))
def test_random_drives_never_enter_a_solid_nor_outrun_gravity(number: int) -> None:
    stage = Stage.of_world(make_rough_world(number))
    faults = [drive_at_random(stage, seed, ticks=100) for seed in range(34)]
    assert [fault for fault in faults if fault] == []


@pytest.mark.parametrize(
    "seed",
    [
        31,  # a wheel in a block, on a side
        261,  # ... after a fall from an edge
        450,  # turned over in the air, faster than gravity
        663,  # sank into the thin end of a ramp as into paint
        1014,  # a search for rest that does not end
        882,  # a tilted wheel in a wall
        909,  # a body that turns over, in a block
        5833,  # ... and leans on one
    ],
)
def test_drive_that_was_wrong_once_is_right(seed: int) -> None:
    stage = Stage.of_world(make_rough_world(seed % NUM_WORLDS))
    assert drive_at_random(stage, seed) == ""


def test_wheels_of_the_file_carry_the_base() -> None:
    # Three wheels: the single one behind, where the floor ends.
    base: DriveBase = replace(P2AT, wheels_m=((0.2, -0.2), (0.2, 0.2), (-0.2, 0.0)))
    ground = ground_of(FLOOR, box(-2.2, 0.0, 0.05, (4.0, 3.0, 0.05)))
    body = ground.place(base, PlanarPose(0.0, 0.0, 0.0), 0.0)
    pitch = body.world_from_robot.to_rpy()[1]
    assert math.sin(-pitch) == pytest.approx(0.05 / 0.4, abs=0.02)
