"""What robots look like to each other: one mesh a class, made once, at each robot's pose."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from catoptra_server.robot.description import RobotDescription
from catoptra_server.scene.bodies import Body, BodyMesh
from catoptra_server.scene.robot_shapes import OmniTower, RobotShape, robot_mesh
from catoptra_server.simulation.spawned_robot import SpawnedRobot


class Appearance:
    """The meshes of all classes. Renderers know a mesh by its identity: it is never made anew."""

    def __init__(self, descriptions: Sequence[RobotDescription]) -> None:
        self._meshes = {d.class_name: _mesh(d) for d in descriptions}

    def bodies(self, robots: Iterable[SpawnedRobot]) -> tuple[Body, ...]:
        """Return the bodies of robots where they stand now."""
        return tuple(
            Body(self._meshes[robot.description.class_name], robot.world_from_robot, robot.twist)
            for robot in robots
        )


def _mesh(description: RobotDescription) -> BodyMesh:
    drive, omni = description.drive, description.omni_camera
    shape = RobotShape(
        drive.dimensions_m, drive.ride_height_m, drive.wheel_radius_m, drive.wheel_base_m
    )
    return robot_mesh(shape, OmniTower(omni.camera, omni.robot_from_mirror) if omni else None)
