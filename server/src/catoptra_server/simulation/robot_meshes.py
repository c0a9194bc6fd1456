"""Meshes of all robot classes, for the views of other robots and of a robot's own mirror."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.frames.robot_camera import CameraRobot
from catoptra_server.robot.robot_description import RobotDescription
from catoptra_server.world.objects import DynamicObject, ObjectMesh
from catoptra_server.world.robot_shapes import (
    OmniCameraTower,
    RobotDimensions,
    build_ego_body_mesh,
    build_robot_mesh,
)


class RobotMeshes:
    """The meshes of a fleet's classes, built once."""

    def __init__(self, descriptions: Sequence[RobotDescription]) -> None:
        # Renderers recognize a mesh by identity: a mesh built anew would be uploaded anew.
        self._meshes = {d.class_name: _build_mesh(d) for d in descriptions}
        self._ego_meshes = {d.class_name: build_ego_mesh(d) for d in descriptions}

    def dynamic_objects(self, robots: Iterable[CameraRobot]) -> tuple[DynamicObject, ...]:
        """Robots as dynamic objects, at their present poses."""
        return tuple(_place_mesh(self._meshes[robot.class_name], robot) for robot in robots)

    def ego_body(self, robot: CameraRobot) -> DynamicObject | None:
        """Parts of a robot that its own mirror may show; None unless the effect is configured."""
        mesh = self._ego_meshes[robot.class_name]
        if mesh is None:
            return None
        return _place_mesh(mesh, robot)


def _place_mesh(mesh: ObjectMesh, robot: CameraRobot) -> DynamicObject:
    return DynamicObject(mesh, robot.world_from_robot, robot.twist, robot.name, robot.number)


def _build_mesh(description: RobotDescription) -> ObjectMesh:
    return build_robot_mesh(_dimensions(description), _tower(description))


def build_ego_mesh(description: RobotDescription) -> ObjectMesh | None:
    """Mesh of a class as its own mirror shows the body; None unless the effect is configured."""
    omni, tower = description.mirror_camera, _tower(description)
    if omni is None or tower is None:
        return None
    is_configured = any(setting.effect.name == SelfView.name for setting in omni.effects.settings)
    # Only where configured: a mesh that no effect shows is never built.
    return build_ego_body_mesh(_dimensions(description), tower) if is_configured else None


def _dimensions(description: RobotDescription) -> RobotDimensions:
    drive = description.drive
    return RobotDimensions(
        drive.dimensions_m, drive.ride_height_m, drive.wheel_radius_m, drive.wheel_base_m
    )


def _tower(description: RobotDescription) -> OmniCameraTower | None:
    omni = description.mirror_camera
    return OmniCameraTower(omni.camera, omni.robot_from_mirror) if omni else None
