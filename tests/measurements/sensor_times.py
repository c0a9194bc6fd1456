"""Time of a cycle of range sensors: 181 beams and 16 sonars, alone and among other robots.

Run: .venv/bin/python tests/measurements/sensor_times.py

Prints the median and the 95th percentile in milliseconds of each sensor of the bundled P2AT, of its
sonars with UDK's cones of 10 rings of 16 rays, and of a whole cycle; in two worlds, without other
robots and with seven. Decision: cones of 3 rings of 8 rays (0.1 ms).
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.render.trace.ray_caster import commit_ray_caster
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.simulation.sensors import SensorContext, SensorEnvironment, build_sensors
from catoptra_server.simulation.sensors.sonar import SonarDescription
from catoptra_server.world.objects import OrientedBox
from catoptra_server.world.scene_mesh import build_scene

REPOSITORY = Path(__file__).parents[2]
_ROUNDS = 300


def main() -> None:
    """Measure all sensors, and print the times."""
    robot, _ = read_robot(REPOSITORY / "configs/robots/p2at.ini")
    ring = [
        OrientedBox(_make_pose(3.0, a), robot.drive.collision_size_m)
        for a in np.linspace(0.0, 6.0, 7)
    ]
    for name in ("four_legged_2006", "corridor"):
        world, _ = read_world(REPOSITORY / f"configs/worlds/{name}.ini")
        caster = commit_ray_caster(build_scene(world))
        for bodies in ([], ring):
            print(f"{name}, {len(bodies)} other robots")
            _measure(robot, SensorEnvironment(caster, bodies))


def _measure(robot: RobotDescription, around: SensorEnvironment) -> None:
    moment = SensorContext(0.0, 1, Pose.from_rpy((0.0, 0.0, -0.1457)), around)
    sensors = build_sensors(robot.sensors, robot.drive, _make_generator)
    for sensor in sensors:
        _print_time(sensor.type, partial(sensor.instrument.read, moment))
    sonars = [s for s in robot.sensors if isinstance(s, SonarDescription)]
    dense = [dataclasses.replace(sonar, num_cones=10, rays_per_cone=16) for sonar in sonars]
    _print_time(
        "Sonar, 10 x 16",
        partial(build_sensors(dense, robot.drive, _make_generator)[0].instrument.read, moment),
    )
    _print_time("whole cycle", lambda: [sensor.instrument.read(moment) for sensor in sensors])


def _make_generator(name: str) -> RandomSource:
    return RandomSource.from_names(1, "R", name)


def _make_pose(radius_m: float, angle_rad: float) -> Pose:
    x, y = radius_m * np.cos(angle_rad), radius_m * np.sin(angle_rad)
    return Pose.from_rpy((x, y, -0.1457), (0.0, 0.0, angle_rad))


def _print_time(name: str, run: Callable[[], object]) -> None:
    times = []
    for _ in range(_ROUNDS):
        begin = time.perf_counter()
        run()
        times.append(1e3 * (time.perf_counter() - begin))
    median, high = np.percentile(times, (50, 95))
    print(f"  {name:14s} {median:7.3f} ms   95 %: {high:7.3f} ms")


if __name__ == "__main__":
    main()
