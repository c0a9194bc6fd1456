"""An ordinary camera on a robot: what it is asked for, and its zoom. Renderers draw its picture."""

from __future__ import annotations

import math
from collections.abc import Mapping

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.reports import CameraConfiguration, GeometryItem
from catoptra_server.robot.description import CameraDescription, RobotDescription


class PerspectiveCameraSensor:
    """One robot's camera; it looks along x from where its mount carries it."""

    type = "Camera"

    def __init__(self, description: CameraDescription, robot: RobotDescription) -> None:
        self.name = description.name
        self.description = description
        self._robot = robot
        self.fov_rad = description.fov_rad

    def zoom(self, fov_rad: float) -> float:
        """Take a field of view within the camera's limits, 0 for its default; return it."""
        is_ = self.description
        wished = fov_rad or is_.fov_rad
        self.fov_rad = min(max(wished, is_.min_fov_rad), is_.max_fov_rad)
        return self.fov_rad

    def robot_from_camera(self, joints: Mapping[str, float]) -> Pose:
        """Return where it is; `joints` are radians by lower-case link name."""
        mount = self.description.mount
        return self._robot.robot_from_part(mount.parent, joints) @ mount.parent_from_item()

    def configuration(self) -> CameraConfiguration:
        """Return its fields of view; without a tile: that is the image server's to give."""
        is_ = self.description
        return CameraConfiguration(
            name=self.name,
            default_fov_deg=math.degrees(is_.fov_rad),
            min_fov_deg=math.degrees(is_.min_fov_rad),
            max_fov_deg=math.degrees(is_.max_fov_rad),
            fov_deg=math.degrees(self.fov_rad),
        )

    def geometry(self) -> GeometryItem:
        """Return where it is mounted, and on what."""
        mount = self.description.mount
        return GeometryItem(self.name, mount.position_m, mount.rotation_rad, mount.parent)
