"""Poses and motions of samples: random in free space, given in the recipe, or driven.

A drive repeats the simulation's ticks from the start of its sequence, so that any process can take
it up anywhere; the last drive is kept, since its samples are mostly drawn one after the other.
"""

from __future__ import annotations

import math

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.commands_drive import Drive
from catoptra_server.datasets.dataset_stage import DatasetStage, RecipeCamera
from catoptra_server.datasets.free_space import draw_free_pose, find_fault
from catoptra_server.datasets.pose_sections import TICK_S
from catoptra_server.datasets.recipe import DrivePoses, GivenPoses, RandomPoses
from catoptra_server.datasets.sampling import SamplePlace, find_place, random_source
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.world.camera_state import NoiseSeed
from catoptra_server.world.world_description import AT_REST, Twist


@dataclass(frozen=True, slots=True, eq=False)
class RobotMotion:
    """Robot of a sample at the time of its exposure."""

    time_s: float
    """Since the begin of the sequence."""
    world_from_robot: Pose
    twist: Twist
    """In world axes, referred to the chassis."""


@dataclass(frozen=True, slots=True, eq=False)
class SampleMotion:
    """Robot now and at the next sample of the sequence."""

    now: RobotMotion
    next: RobotMotion | None
    """None at the end of a path, and where samples do not follow each other."""


class PoseSource:
    """Poses of the samples of a recipe, for one process."""

    def __init__(self, stage: DatasetStage) -> None:
        self._stage = stage
        self._recipe = stage.recipe
        self._drive: tuple[int, list[RobotMotion]] = (-1, [])
        """Number of the last drive's sequence, and its motions."""

    def find_motion(self, place: SamplePlace) -> SampleMotion:
        """Robot of a sample.

        Raises:
            CatoptraError: There is no free space for a random pose.
        """
        poses = self._recipe.poses
        if isinstance(poses, GivenPoses):
            return self._given_motion(poses, place)
        if isinstance(poses, RandomPoses):
            return SampleMotion(self._random_motion(poses, place), None)
        if self._drive[0] != place.sequence:
            self._drive = (place.sequence, self._simulate_drive(poses, place))
        motions = self._drive[1]
        return SampleMotion(motions[place.step], motions[place.step + 1])

    def _given_motion(self, poses: GivenPoses, place: SamplePlace) -> SampleMotion:
        camera = self._stage.cameras[place.camera]
        steps = [place.step, place.step + 1]
        motions = [_given_robot(camera, poses, step) for step in steps if step < len(poses.poses)]
        has_next = poses.is_path and len(motions) > 1
        return SampleMotion(motions[0], motions[1] if has_next else None)

    def _random_motion(self, poses: RandomPoses, place: SamplePlace) -> RobotMotion:
        world, camera = self._stage.world(place.world), self._stage.cameras[place.camera]
        generator = random_source(self._recipe, "pose").generator(place.index)
        pose = draw_free_pose(world, camera, poses, generator)
        motion = random_source(self._recipe, "motion").generator(place.index)
        speed, rate = poses.speed_m_s.draw(motion), poses.yaw_rate_rad_s.draw(motion)
        return RobotMotion(0.0, _stand(camera, pose), _planar_twist(pose, speed, rate))

    def _simulate_drive(self, poses: DrivePoses, place: SamplePlace) -> list[RobotMotion]:
        """Motions of all samples of a drive, and of one more for the last one's flow."""
        world, camera = self._stage.world(place.world), self._stage.cameras[place.camera]
        recipe, sequence = self._recipe, place.sequence
        start = draw_free_pose(
            world, camera, poses.start, random_source(recipe, "pose").generator(sequence)
        )
        robot = Robot(camera.robot, start, name=f"drive {sequence}", seed=recipe.seed, time_s=0.0)
        speeds = random_source(recipe, "wheel speeds").generator(sequence)
        motions: list[RobotMotion] = []
        ticks_a_sample, hold_ticks = round(poses.interval_s / TICK_S), 0
        for tick in range(poses.num_samples * ticks_a_sample + 1):
            time_s = tick * TICK_S
            if tick % ticks_a_sample == 0:
                motions.append(RobotMotion(time_s, robot.world_from_robot, robot.twist))
            if hold_ticks == 0:
                left, right = (poses.wheel_speed_rad_s.draw(speeds) for _ in range(2))
                hold_ticks = max(1, round(poses.hold_s.draw(speeds) / TICK_S))
                robot.drive_wheels(Drive(left=left, right=right), time_s)
            hold_ticks -= 1
            robot.step(TICK_S, time_s + TICK_S, world.obstacles.obstacles_near(robot, ()))
        return motions


def seed_noise(stage: DatasetStage, place: SamplePlace) -> NoiseSeed:
    """Seed of the image noise of a sample: another in each, whatever the camera."""
    return NoiseSeed.from_source(random_source(stage.recipe, "noise"), place.index)


def check_given_poses(stage: DatasetStage) -> None:
    """Check every given pose in each world and for each robot that takes it.

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
        fault = find_fault(world, camera, given.pose)
        if fault:
            x, y, yaw = given.pose.x_m, given.pose.y_m, given.pose.yaw_rad
            raise CatoptraError(
                f"{given.where}: pose {place.step + 1} (X={x:g}, Y={y:g}, Yaw={yaw:g}) is not free "
                f"for {camera.robot.class_name} in world {world.name}: {fault}"
            )


def _given_robot(camera: RecipeCamera, poses: GivenPoses, step: int) -> RobotMotion:
    pose = poses.poses[step].pose
    twist = _planar_twist(pose, poses.speed_m_s, 0.0)
    return RobotMotion(step * poses.interval_s, _stand(camera, pose), twist)


def _stand(camera: RecipeCamera, pose: PlanarPose) -> Pose:
    return pose.at_height(camera.robot.drive.ride_height_m)


def _planar_twist(pose: PlanarPose, speed_m_s: float, yaw_rate_rad_s: float) -> Twist:
    if speed_m_s == 0.0 and yaw_rate_rad_s == 0.0:
        return AT_REST
    linear = (speed_m_s * math.cos(pose.yaw_rad), speed_m_s * math.sin(pose.yaw_rad), 0.0)
    return Twist(linear, (0.0, 0.0, yaw_rate_rad_s))
