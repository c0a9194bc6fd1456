"""World, camera, pose, motion and light of each sample, by recipe and index alone.

Samples of one sequence follow each other: a whole path, drive or grid, or one random pose. The next
sequence has the next world and camera of all combinations, cameras changing first. The sections of
a recipe about poses:

    [Catoptra.RandomPoses]  Clearance, MaxTries, X, Y, Yaw, Speed, YawRate
    [Catoptra.GridPoses]    X, Y, Yaw: (Min=,Max=,Count=)
    [Catoptra.PathPoses]    Points=(X=,Y=), one a line; Spacing, Speed
    [Catoptra.DrivePoses]   Samples, Interval, WheelSpeed, Hold; for the start, all of RandomPoses

A pose is X, Y in metres and Yaw in radians, clockwise from above; the robot stands on the floor. A
pose is free by the contact of driving robots (`simulation/collision_index.py`), seen from above.
Rays tell what outlines cannot: one down for the floor, and level ones for the inside of a solid,
whose surface is met from behind on all sides. A drive repeats the simulation's ticks from the start
of the sequence, so that any process can go on anywhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.elementary import arctan2, hypot, matmul
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.commands import Drive
from catoptra_protocol.usarsim.configurations import CHASSIS_MOUNT
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.world_file import MAX_LENGTH_M
from catoptra_server.datasets.dataset_stage import DatasetStage, RecipeCamera, RecipeWorld
from catoptra_server.datasets.randomise import (
    FIRST_ROBOT,
    FreeSpace,
    PlacedThing,
    ThingMaker,
    random_source,
)
from catoptra_server.datasets.recipe import (
    BrightnessLevels,
    DrivePoses,
    GivenPose,
    GivenPoses,
    PoseRecipe,
    Randomisation,
    RandomPoses,
    Recipe,
    ValueRange,
    read_range,
    read_range_struct,
)
from catoptra_server.simulation.chassis import GRAVITY_M_S2
from catoptra_server.simulation.collision_index import collision_height_m
from catoptra_server.simulation.drive import RobotBody
from catoptra_server.simulation.ground import NoStandError
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_bodies import build_outer_meshes
from catoptra_server.simulation.robot_description import PlanarPose, RobotDescription
from catoptra_server.world.objects import DynamicObject, NoiseSeed
from catoptra_server.world.world_description import AT_REST, Twist

POSE_KINDS = ("random", "grid", "path", "drive")
_TICK_S = 0.02
"""Tick of drives, a server's default."""
_FULL_TURN = ValueRange(0.0, 2.0 * math.pi)
_ZERO = ValueRange(0.0, 0.0)
# Other robots' drives: at samples that follow no other, after half a second of it.
_SPEEDS, _HOLD_S, _ONE_SAMPLE_S, _MAX_STARTS = ValueRange(-1.0, 5.0), ValueRange(0.5, 2.0), 0.5, 8
_MAX_TURN_RAD = 100.0
_MAX_SPEED = 100.0
# Each pose is checked against the obstacles of each world before anything is drawn.
_MAX_POSES = 1_000_000
_MAX_COUNT = 10_000
_NUM_LEVEL_RAYS = 8
# Above sills and carpets, which robots drive over.
_RAY_HEIGHT_M = 0.1


@dataclass(frozen=True, slots=True)
class SamplePlace:
    """Place of a sample in a data set."""

    index: int
    sequence: int
    step: int
    """Number within the sequence."""
    world: int
    """Number of the world in the recipe."""
    camera: int


def find_place(recipe: Recipe, index: int) -> SamplePlace:
    """Place of a sample."""
    sequence, step = divmod(index, _sequence_length(recipe))
    world, camera = divmod(
        sequence % (len(recipe.worlds) * len(recipe.cameras)), len(recipe.cameras)
    )
    return SamplePlace(index, sequence, step, world, camera)


def _sequence_length(recipe: Recipe) -> int:
    """Samples of a sequence."""
    if isinstance(recipe.poses, GivenPoses):
        return len(recipe.poses.poses)
    return recipe.poses.num_samples if isinstance(recipe.poses, DrivePoses) else 1


def seed_noise(stage: DatasetStage, place: SamplePlace) -> NoiseSeed:
    """Seed of the image noise of a sample: another in each, whatever the camera."""
    return NoiseSeed.from_source(random_source(stage.recipe, "noise"), place.index)


def draw_brightness(recipe: Recipe, index: int) -> float:
    """Factor of all lights in a sample."""
    return _draw_level(recipe, recipe.brightness, "brightness", index)


def draw_group_brightness(recipe: Recipe, index: int) -> dict[str, float]:
    """Factors of groups of lights in a sample, by name."""
    levels = recipe.group_brightness.items()
    return {name: _draw_level(recipe, one, f"brightness {name}", index) for name, one in levels}


def _draw_level(recipe: Recipe, levels: BrightnessLevels, source: str, index: int) -> float:
    number = random_source(recipe, source).generator(index).integers(levels.levels)
    return levels.level(int(number))


@dataclass(frozen=True, slots=True, eq=False)
class RobotMotion:
    """Robot of a sample at the time of the exposure."""

    time_s: float
    """Since the begin of the sequence."""
    world_from_robot: Pose
    twist: Twist
    """In world axes, referred to the chassis."""


@dataclass(frozen=True, slots=True, eq=False)
class _SampleMotion:
    """Robot now and at the next sample of the sequence."""

    now: RobotMotion
    next: RobotMotion | None
    """None at the end of a path, and where samples do not follow each other."""
    imu: Floats | None = None
    """(n, 7) of a drive's ticks from this sample to the next, where the recipe asks for them."""


class PoseSource:
    """Poses of the samples of a recipe, for one process."""

    def __init__(self, stage: DatasetStage) -> None:
        self._stage = stage
        self._recipe = stage.recipe
        self._drive: tuple[int, list[RobotMotion], Floats] = (-1, [], np.zeros((0, 7)))
        """Number of the last drive's sequence, the motions, and all that an IMU measures."""

    def find_motion(self, place: SamplePlace) -> _SampleMotion:
        """Robot of a sample.

        Raises:
            CatoptraError: There is no free space for a random pose.
        """
        poses = self._recipe.poses
        if isinstance(poses, GivenPoses):
            return self._given_motion(poses, place)
        if isinstance(poses, RandomPoses):
            return _SampleMotion(self._random_motion(poses, place), None)
        if self._drive[0] != place.sequence:
            self._drive = (place.sequence, *self._simulate_drive(poses, place))
        motions, measured = self._drive[1:]
        ticks = round(poses.interval_s / _TICK_S)
        imu = measured[place.step * ticks : (place.step + 1) * ticks]
        wants_imu = "asl" in self._recipe.formats
        return _SampleMotion(
            motions[place.step], motions[place.step + 1], imu if wants_imu else None
        )

    def find_way(self, place: SamplePlace) -> Floats:
        """(n, 3) places of the robot in the sequence of a sample, without its last motion."""
        poses = self._recipe.poses
        if not isinstance(poses, GivenPoses):
            motions = [self.find_motion(place).now]
            if isinstance(poses, DrivePoses):
                motions = self._drive[1][: poses.num_samples]
            return np.array([one.world_from_robot.translation for one in motions])
        here = self.find_motion(place).now.world_from_robot.translation
        return np.array([(one.pose.x_m, one.pose.y_m, here[2]) for one in poses.poses])

    def find_other_robots(self, place: SamplePlace, space: FreeSpace) -> list[list[RobotMotion]]:
        """Motions of the other robots, from the first sample of the sequence to one after the
        last; none of a robot that has no room."""
        poses, world = self._recipe.poses, self._stage.world(place.world)
        interval_s, count = _ONE_SAMPLE_S, 0
        if not isinstance(poses, RandomPoses):
            interval_s, count = poses.interval_s or _ONE_SAMPLE_S, _sequence_length(self._recipe)
        motions: list[list[RobotMotion]] = []
        for number, description in enumerate(self._stage.other_robots, 1):
            name = f"robot {number}"
            draw = random_source(self._recipe, f"{name} place").generator(place.sequence)
            body = _find_start(world, description, space, draw)
            if body is None:
                motions.append([])
                continue
            robot = Robot(description, body, name=name, seed=self._recipe.seed, time_s=0.0)
            speeds = random_source(self._recipe, f"{name} speeds").generator(place.sequence)
            # Each begins to move before the first sample.
            found, _ = _drive(robot, world, speeds, _SPEEDS, _HOLD_S, count + 1, interval_s)
            motions.append(found[1:])
        return motions

    def _given_motion(self, poses: GivenPoses, place: SamplePlace) -> _SampleMotion:
        camera = self._stage.cameras[place.camera]
        steps = [place.step, place.step + 1]
        world = self._stage.world(place.world)
        motions = [
            _given_robot(world, camera, poses, step) for step in steps if step < len(poses.poses)
        ]
        has_next = poses.is_path and len(motions) > 1
        return _SampleMotion(motions[0], motions[1] if has_next else None)

    def _random_motion(self, poses: RandomPoses, place: SamplePlace) -> RobotMotion:
        world, camera = self._stage.world(place.world), self._stage.cameras[place.camera]
        generator = random_source(self._recipe, "pose").generator(place.index)
        body = _draw_free_pose(world, camera, poses, generator)
        motion = random_source(self._recipe, "motion").generator(place.index)
        speed, rate = poses.speed_m_s.draw(motion), poses.yaw_rate_rad_s.draw(motion)
        where = body.world_from_robot
        return RobotMotion(0.0, where, _driving_twist(where, speed, rate))

    def _simulate_drive(
        self, poses: DrivePoses, place: SamplePlace
    ) -> tuple[list[RobotMotion], Floats]:
        """Motions of all samples of a drive, and of one more for the last one's flow; the IMU."""
        world, camera = self._stage.world(place.world), self._stage.cameras[place.camera]
        recipe, sequence = self._recipe, place.sequence
        start = _draw_free_pose(
            world, camera, poses.start, random_source(recipe, "pose").generator(sequence)
        )
        robot = Robot(camera.robot, start, name=f"drive {sequence}", seed=recipe.seed, time_s=0.0)
        speeds = random_source(recipe, "wheel speeds").generator(sequence)
        wheels, hold = poses.wheel_speed_rad_s, poses.hold_s
        count, step_s = poses.num_samples, poses.interval_s
        motions, places = _drive(robot, world, speeds, wheels, hold, count, step_s)
        return motions, measure_motion(places, _TICK_S)


def _drive(
    robot: Robot,
    world: RecipeWorld,
    speeds: np.random.Generator,
    wheel_speed_rad_s: ValueRange,
    hold_s: ValueRange,
    num_samples: int,
    interval_s: float,
) -> tuple[list[RobotMotion], list[Pose]]:
    """Motions of a robot that drives by random wheel speeds, at the samples and at one more, and
    the poses of all ticks."""
    motions: list[RobotMotion] = []
    places: list[Pose] = []
    ticks_a_sample, hold_ticks = max(1, round(interval_s / _TICK_S)), 0
    for tick in range(num_samples * ticks_a_sample + 1):
        time_s = tick * _TICK_S
        places.append(robot.world_from_robot)
        if tick % ticks_a_sample == 0:
            motions.append(RobotMotion(time_s, robot.world_from_robot, robot.twist))
        if hold_ticks == 0:
            left, right = (wheel_speed_rad_s.draw(speeds) for _ in range(2))
            hold_ticks = max(1, round(hold_s.draw(speeds) / _TICK_S))
            robot.drive_wheels(Drive(left=left, right=right), time_s)
        hold_ticks -= 1
        robot.step(_TICK_S, time_s + _TICK_S, world.ground.mover_of(robot, ()))
    return motions, places


def _find_start(
    world: RecipeWorld,
    description: RobotDescription,
    space: FreeSpace,
    generator: np.random.Generator,
) -> RobotBody | None:
    """Base of another robot at rest near the way of the camera's; None: there is no room."""
    radius_m = 0.5 * hypot(*description.drive.collision_size_m[:2])
    for _ in range(_MAX_STARTS):
        place = space.take(generator, radius_m, collision_height_m(description))
        if place is None:
            return None
        pose = PlanarPose(place[0].item(), place[1].item(), _FULL_TURN.draw(generator))
        with suppress(NoStandError):
            return world.ground.place(description, pose, place[2].item())
    return None


class Surroundings:
    """What stands and drives about the camera's robot, of a recipe's sequences."""

    def __init__(self, stage: DatasetStage, poses: PoseSource) -> None:
        """Place nothing yet.

        Args:
            stage: The recipe, loaded.
            poses: Poses of the camera's robot.
        """
        self._stage, self._poses = stage, poses
        self._things = ThingMaker(stage.recipe)
        self._find_meshes = cache(build_outer_meshes)
        self._placed: tuple[int, list[PlacedThing], list[list[RobotMotion]]] = (-1, [], [])
        """Number of the last sequence, what stands there, and the other robots' motions."""

    def find_objects(self, place: SamplePlace, after: int = 0) -> tuple[DynamicObject, ...]:
        """Objects at a sample, or so many samples after it.

        Raises:
            CatoptraError: There is no free space.
        """
        varied = self._stage.recipe.randomisation
        if varied is None or not (varied.robots or varied.classes):
            return ()
        if self._placed[0] != place.sequence:
            self._placed = (place.sequence, *self._place(place, varied))
        _, things, robots = self._placed
        standing = (
            DynamicObject(
                one.mesh, one.world_from_thing, AT_REST, one.name, one.number, one.class_name
            )
            for one in things
        )
        driving = (
            one
            for number, (description, motions) in enumerate(
                zip(self._stage.other_robots, robots, strict=True)
            )
            if motions
            for one in self._show_robot(description, motions[place.step + after], number)
        )
        return (*driving, *standing)

    def _place(
        self, place: SamplePlace, varied: Randomisation
    ) -> tuple[list[PlacedThing], list[list[RobotMotion]]]:
        world, camera = self._stage.world(place.world), self._stage.cameras[place.camera]
        radius_m = 0.5 * hypot(*camera.robot.drive.collision_size_m[:2])
        space = FreeSpace(world.caster, self._poses.find_way(place), radius_m, varied.distance_m)
        robots = self._poses.find_other_robots(place, space)
        return self._things.place_all(space, place.sequence, world.name), robots

    def _show_robot(
        self, description: RobotDescription, motion: RobotMotion, number: int
    ) -> Iterator[DynamicObject]:
        """Chassis of a robot, and its links at rest."""
        base = motion.world_from_robot
        for link, mesh in self._find_meshes(description).items():
            at = base if link == CHASSIS_MOUNT else base @ description.robot_from_part(link, {})
            twist = motion.twist.at_offset(at.translation - base.translation)
            name = f"{description.model_name}.{number + 1}"
            yield DynamicObject(mesh, at, twist, name, FIRST_ROBOT + number)


def measure_motion(places: Sequence[Pose], step_s: float) -> Floats:
    """(n - 1, 7) exact measurements of an IMU at the chassis' origin, of n consecutive poses.

    Time in s, rates in rad/s and specific forces in m/s^2, both in the robot's axes, of the step
    that begins then: R' = R exp(w dt), v' = v + (R f + g) dt, p' = p + v' dt from rest, g down,
    integrate to the poses.
    """
    rotations = np.array([one.rotation for one in places])
    points = np.array([one.translation for one in places])
    turns = matmul(np.swapaxes(rotations[:-1], 1, 2), rotations[1:])
    rows, columns = (2, 0, 1), (1, 2, 0)
    axis = 0.5 * (turns[:, rows, columns] - turns[:, columns, rows])
    sine = hypot(axis[:, 0], axis[:, 1], axis[:, 2])
    cosine = 0.5 * (turns[:, 0, 0] + turns[:, 1, 1] + turns[:, 2, 2] - 1.0)
    # The angle over its sine is 1 for the smallest.
    factor = np.where(sine > 0.0, arctan2(sine, cosine) / np.where(sine > 0.0, sine, 1.0), 1.0)
    velocities = np.diff(points, axis=0) / step_s
    forces = np.diff(velocities, axis=0, prepend=0.0) / step_s - np.array((0.0, 0.0, GRAVITY_M_S2))
    in_body = matmul(forces[:, None], rotations[:-1])[:, 0]
    times = step_s * np.arange(len(turns))
    return np.column_stack((times, axis * (factor / step_s)[:, None], in_body))


def _given_robot(
    world: RecipeWorld, camera: RecipeCamera, poses: GivenPoses, step: int
) -> RobotMotion:
    where = world.ground.place(camera.robot, poses.poses[step].pose).world_from_robot
    twist = _driving_twist(where, poses.speed_m_s, 0.0)
    return RobotMotion(step * poses.interval_s, where, twist)


def _driving_twist(world_from_robot: Pose, speed_m_s: float, yaw_rate_rad_s: float) -> Twist:
    """Motion ahead and about the robot's own axis."""
    if speed_m_s == 0.0 and yaw_rate_rad_s == 0.0:
        return AT_REST
    # Without negative zeros.
    ahead, _, down = (world_from_robot.rotation.T + 0.0).tolist()
    linear = (speed_m_s * ahead[0], speed_m_s * ahead[1], speed_m_s * ahead[2])
    rate = yaw_rate_rad_s
    return Twist(linear, (rate * down[0], rate * down[1], rate * down[2]))


def _draw_free_pose(
    world: RecipeWorld, camera: RecipeCamera, poses: RandomPoses, generator: np.random.Generator
) -> RobotBody:
    """Base at a random pose in free space, uniform over the allowed area.

    Raises:
        CatoptraError: No free pose within the tries that the recipe allows.
    """
    low, high = world.scene.box_min, world.scene.box_max
    x_m = poses.x_m or ValueRange(float(low[0]), float(high[0]))
    y_m = poses.y_m or ValueRange(float(low[1]), float(high[1]))
    reason = ""
    for _ in range(poses.max_tries):
        # Three numbers a try, so that the next try does not depend on the reason of this one.
        pose = PlanarPose(*(values.draw(generator) for values in (x_m, y_m, poses.yaw_rad)))
        try:
            return world.ground.place(camera.robot, pose, clearance_m=poses.clearance_m)
        except NoStandError as error:
            reason = str(error)
    raise CatoptraError(
        f"{poses.where}: no free pose for {camera.robot.class_name} in world {world.name} within "
        f"{poses.max_tries} tries (the last one: {reason}); give X= and Y= a free area, lower "
        "Clearance or raise MaxTries"
    )


def check_given_poses(stage: DatasetStage) -> None:
    """Check every given pose in each world and for each robot there.

    Raises:
        CatoptraError: A pose is not free; names file, line, pose and reason.
    """
    poses = stage.recipe.poses
    if not isinstance(poses, GivenPoses):
        return
    checked: set[tuple[int, str, int]] = set()
    recipe = stage.recipe
    # Sequences repeat after all combinations of worlds and cameras.
    num_places = len(poses.poses) * len(recipe.worlds) * len(recipe.cameras)
    for index in range(min(recipe.num_samples, num_places)):
        place = find_place(recipe, index)
        camera = stage.cameras[place.camera]
        key = (place.world, camera.robot.class_name, place.step)
        if key in checked:
            continue
        checked.add(key)
        given, world = poses.poses[place.step], stage.world(place.world)
        try:
            world.ground.place(camera.robot, given.pose)
        except NoStandError as error:
            x, y, yaw = given.pose.x_m, given.pose.y_m, given.pose.yaw_rad
            raise CatoptraError(
                f"{given.where}: pose {place.step + 1} (X={x:g}, Y={y:g}, Yaw={yaw:g}) is not free "
                f"for {camera.robot.class_name} in world {world.name}: {error}"
            ) from error


def read_poses(file: IniFile, kind: str) -> PoseRecipe:
    """Poses of a kind.

    Raises:
        ConfigError: For a missing key, an empty range, or too many poses.
    """
    match kind:
        case "random":
            return _read_random(file.get_section("Catoptra.RandomPoses"))
        case "grid":
            return _read_grid(file.get_section("Catoptra.GridPoses"))
        case "path":
            return _read_path(file.get_section("Catoptra.PathPoses"))
        case _:
            return _read_drive(file.get_section("Catoptra.DrivePoses"))


def _read_random(section: SectionReader) -> RandomPoses:
    return RandomPoses(
        clearance_m=section.get_float("Clearance", 0.02, min_value=0.0, max_value=100.0),
        max_tries=section.get_int("MaxTries", 1000, min_value=1, max_value=1_000_000),
        x_m=_read_extent(section, "X"),
        y_m=_read_extent(section, "Y"),
        yaw_rad=read_range(
            section, "Yaw", _FULL_TURN, min_value=-_MAX_TURN_RAD, max_value=_MAX_TURN_RAD
        ),
        speed_m_s=read_range(section, "Speed", _ZERO, min_value=-_MAX_SPEED, max_value=_MAX_SPEED),
        yaw_rate_rad_s=read_range(
            section, "YawRate", _ZERO, min_value=-_MAX_SPEED, max_value=_MAX_SPEED
        ),
        where=section.where,
    )


def _read_extent(section: SectionReader, key: str) -> ValueRange | None:
    if not section.get_str(key, ""):
        return None
    return read_range(section, key, _ZERO, min_value=-MAX_LENGTH_M, max_value=MAX_LENGTH_M)


def _read_grid(section: SectionReader) -> GivenPoses:
    xs, ys = (_read_axis(section, key, MAX_LENGTH_M) for key in "XY")
    yaws = _read_axis(section, "Yaw", _MAX_TURN_RAD) if section.has_key("Yaw") else [0.0]
    if len(xs) * len(ys) * len(yaws) > _MAX_POSES:
        raise section.make_error("X", expected=f"a grid of at most {_MAX_POSES} poses")
    where = section.find_location("X")
    poses = tuple(GivenPose(PlanarPose(x, y, yaw), where) for x in xs for y in ys for yaw in yaws)
    return GivenPoses(poses, is_path=False, interval_s=0.0, speed_m_s=0.0)


def _read_axis(section: SectionReader, key: str, max_value: float) -> list[float]:
    """Evenly spaced values, both ends included."""
    struct = section.get_struct(key, example="(Min=-1,Max=1,Count=5)")
    extent = read_range_struct(section, key, struct, -max_value, max_value)
    count = struct.get_int("Count", min_value=1, max_value=_MAX_COUNT)
    return [float(value) for value in np.linspace(extent.low, extent.high, count)]


def _read_path(section: SectionReader) -> GivenPoses:
    spacing_m = section.get_float("Spacing", 0.1, min_value=1e-3, max_value=MAX_LENGTH_M)
    speed_m_s = section.get_float("Speed", 0.5, min_value=1e-3, max_value=_MAX_SPEED)
    points = section.get_structs("Points", example="(X=0,Y=0)")
    if len(points) < 2:
        raise section.make_error("Points", expected="at least two points, such as (X=0,Y=0)")
    places = [
        np.array([p.get_float(k, min_value=-MAX_LENGTH_M, max_value=MAX_LENGTH_M) for k in "XY"])
        for p in points
    ]
    poses: list[GivenPose] = []
    travelled_m = 0.0  # along all lines so far
    for begin, end, point in zip(places, places[1:], points[1:], strict=False):
        length_m = float(hypot(*(end - begin)))
        if length_m == 0.0:
            raise point.make_error("X", expected="a point apart from the one before")
        yaw_rad = arctan2(end[1] - begin[1], end[0] - begin[0])
        # The next multiple of the spacing, counted from the first point: corners do not restart the
        # count.
        first = math.ceil(travelled_m / spacing_m - 1e-9)
        last = math.floor((travelled_m + length_m) / spacing_m + 1e-9)
        if len(poses) + last - first > _MAX_POSES:
            raise section.make_error("Spacing", expected=f"a path of at most {_MAX_POSES} poses")
        for number in range(first, last + 1):
            if number < len(poses):  # a pose at the corner belongs to the line before
                continue
            x, y = begin + (end - begin) * ((number * spacing_m - travelled_m) / length_m)
            poses.append(GivenPose(PlanarPose(float(x), float(y), yaw_rad), point.where))
        travelled_m += length_m
    return GivenPoses(
        tuple(poses), is_path=True, interval_s=spacing_m / speed_m_s, speed_m_s=speed_m_s
    )


def _read_drive(section: SectionReader) -> DrivePoses:
    interval_s = section.get_float("Interval", 0.2, min_value=_TICK_S, max_value=3600.0)
    ticks = round(interval_s / _TICK_S)
    if abs(ticks * _TICK_S - interval_s) > 1e-9:
        raise section.make_error("Interval", expected=f"a multiple of the tick of {_TICK_S} s")
    return DrivePoses(
        start=_read_random(section),
        num_samples=section.get_int("Samples", 50, min_value=1, max_value=100_000),
        interval_s=interval_s,
        wheel_speed_rad_s=read_range(
            section, "WheelSpeed", ValueRange(-1.0, 5.0), min_value=-1000.0, max_value=1000.0
        ),
        hold_s=read_range(
            section, "Hold", ValueRange(0.5, 2.0), min_value=_TICK_S, max_value=3600.0
        ),
    )
