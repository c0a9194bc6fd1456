"""What robots look like to each other and to themselves: a class' meshes, at each robot's pose."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from catoptra_server.effects.own_body import OwnBody
from catoptra_server.robot.description import RobotDescription
from catoptra_server.scene.bodies import Body, BodyMesh
from catoptra_server.scene.robot_shapes import OmniTower, RobotShape, own_body_mesh, robot_mesh
from catoptra_server.simulation.spawned_robot import SpawnedRobot


class Appearance:
    """The meshes of all classes. Renderers know a mesh by its identity: it is never made anew."""

    def __init__(self, descriptions: Sequence[RobotDescription]) -> None:
        self._meshes = {d.class_name: _mesh(d) for d in descriptions}
        self._own = {d.class_name: own_mesh(d) for d in descriptions}

    def bodies(self, robots: Iterable[SpawnedRobot]) -> tuple[Body, ...]:
        """Return the bodies of robots where they stand now."""
        return tuple(
            Body(self._meshes[robot.description.class_name], robot.world_from_robot, robot.twist)
            for robot in robots
        )

    def own_body(self, robot: SpawnedRobot) -> Body | None:
        """Return what a robot's mirror may see of it; None where its file does not ask for that."""
        mesh = self._own[robot.description.class_name]
        return Body(mesh, robot.world_from_robot, robot.twist) if mesh is not None else None


def _mesh(description: RobotDescription) -> BodyMesh:
    return robot_mesh(_shape(description), _tower(description))


def own_mesh(description: RobotDescription) -> BodyMesh | None:
    """Return what a class's mirror sees of it, if its camera's effects name that."""
    omni, tower = description.omni_camera, _tower(description)
    if omni is None or tower is None:
        return None
    is_named = any(wish.effect.name == OwnBody.name for wish in omni.effects.wishes)
    return own_body_mesh(_shape(description), tower) if is_named else None


def _shape(description: RobotDescription) -> RobotShape:
    drive = description.drive
    return RobotShape(
        drive.dimensions_m, drive.ride_height_m, drive.wheel_radius_m, drive.wheel_base_m
    )


def _tower(description: RobotDescription) -> OmniTower | None:
    omni = description.omni_camera
    return OmniTower(omni.camera, omni.robot_from_mirror) if omni else None
