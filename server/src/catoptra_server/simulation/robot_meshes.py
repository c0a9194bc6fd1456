"""What robots look like to each other and to themselves: a class' meshes, at each robot's pose."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.robot.robot_description import RobotDescription
from catoptra_server.scene.dynamic_object import DynamicObject, ObjectMesh
from catoptra_server.scene.robot_shapes import (
    OmniCameraTower,
    RobotDimensions,
    build_ego_body_mesh,
    build_robot_mesh,
)
from catoptra_server.simulation.robot import Robot


class RobotMeshes:
    """The meshes of all classes. Renderers know a mesh by its identity: it is never made anew."""

    def __init__(self, descriptions: Sequence[RobotDescription]) -> None:
        self._meshes = {d.class_name: _build_mesh(d) for d in descriptions}
        self._ego_meshes = {d.class_name: build_ego_mesh(d) for d in descriptions}

    def dynamic_objects(self, robots: Iterable[Robot]) -> tuple[DynamicObject, ...]:
        """Return the bodies of robots where they stand now."""
        return tuple(
            DynamicObject(
                self._meshes[robot.description.class_name], robot.world_from_robot, robot.twist
            )
            for robot in robots
        )

    def ego_body(self, robot: Robot) -> DynamicObject | None:
        """Return what a robot's mirror may see of it; None where its file does not ask for that."""
        mesh = self._ego_meshes[robot.description.class_name]
        return (
            DynamicObject(mesh, robot.world_from_robot, robot.twist) if mesh is not None else None
        )


def _build_mesh(description: RobotDescription) -> ObjectMesh:
    return build_robot_mesh(_shape(description), _tower(description))


def build_ego_mesh(description: RobotDescription) -> ObjectMesh | None:
    """Return what a class's mirror sees of it, if its camera's effects name that."""
    omni, tower = description.omni_camera, _tower(description)
    if omni is None or tower is None:
        return None
    is_named = any(wish.effect.name == SelfView.name for wish in omni.effects.settings)
    return build_ego_body_mesh(_shape(description), tower) if is_named else None


def _shape(description: RobotDescription) -> RobotDimensions:
    drive = description.drive
    return RobotDimensions(
        drive.dimensions_m, drive.ride_height_m, drive.wheel_radius_m, drive.wheel_base_m
    )


def _tower(description: RobotDescription) -> OmniCameraTower | None:
    omni = description.omni_camera
    return OmniCameraTower(omni.camera, omni.robot_from_mirror) if omni else None
