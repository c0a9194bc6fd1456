"""A perspective camera on a robot: pose, zoom and camera model. Renderers draw it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from catoptra_protocol.camera_conf import Pairs, pairs_from_perspective_camera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.configurations import TextureRegion
from catoptra_protocol.usarsim.reports import CameraConfiguration, GeometryItem
from catoptra_server.frames.multi_view import Tile
from catoptra_server.frames.plan.camera import PerspectiveCameraSpec
from catoptra_server.simulation.robot_description import (
    PerspectiveCameraDescription,
    RobotDescription,
)


class PerspectiveCameraSensor:
    """Perspective camera of one robot, looking along the x axis of the mount."""

    type = "Camera"

    def __init__(self, description: PerspectiveCameraDescription, robot: RobotDescription) -> None:
        """Mount the camera at its default field of view."""
        self.name = description.name
        self.description = description
        self.tile: Tile | None = None
        self._robot = robot
        self.fov_rad = description.fov_rad

    def zoom(self, fov_rad: float) -> float:
        """Set the horizontal field of view, clamped to the camera's limits.

        Args:
            fov_rad: Requested field of view; 0 for the default, as SET Camera FOV has it.

        Returns:
            The field of view of the next frames.
        """
        limits = self.description
        requested = fov_rad or limits.fov_rad
        # Clamped, not rejected: RES reports the field of view that the camera took.
        self.fov_rad = min(max(requested, limits.min_fov_rad), limits.max_fov_rad)
        return self.fov_rad

    def robot_from_camera(self, joint_angles_rad: Mapping[str, float]) -> Pose:
        """Pose of the pinhole, given joint angles by lower-case link name."""
        mount = self.description.mount
        # A camera on a pan-tilt head moves with the joints.
        parent_in_robot = self._robot.robot_from_part(mount.parent, joint_angles_rad)
        return parent_in_robot @ mount.parent_from_item()

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the camera's own image."""
        return self.description.width_px, self.description.height_px

    @property
    def min_frame_interval_s(self) -> float:
        """Shortest simulation time between two exposures: no limit."""
        return 0.0

    def camera_spec(self, tile: Tile | None = None) -> PerspectiveCameraSpec:
        """Camera at the size of a tile, at its own size without one, with its effects."""
        return PerspectiveCameraSpec(self._camera_for_tile(tile), self.description.effects)

    def _camera_for_tile(self, tile: Tile | None) -> PerspectiveCamera:
        # The horizontal field of view is kept: a tile of another shape shows more or less height.
        width, height = (tile.width_px, tile.height_px) if tile else self.size_px
        return PerspectiveCamera(width, height, self.fov_rad)

    def camera_model(self, tile: Tile | None = None) -> Pairs:
        """Key-value pairs of the camera model, enough to compute the direction of every pixel."""
        return pairs_from_perspective_camera(self._camera_for_tile(tile))

    def configuration(self) -> CameraConfiguration:
        """CONF: fields of view and tile."""
        limits = self.description
        return CameraConfiguration(
            name=self.name,
            default_fov_deg=math.degrees(limits.fov_rad),
            min_fov_deg=math.degrees(limits.min_fov_rad),
            max_fov_deg=math.degrees(limits.max_fov_rad),
            fov_deg=math.degrees(self.fov_rad),
            texture_region=TextureRegion(*dataclasses.astuple(self.tile)) if self.tile else None,
        )

    def geometry(self) -> GeometryItem:
        """GEO: pose and parent of the mount."""
        mount = self.description.mount
        return GeometryItem(self.name, mount.position_m, mount.rotation_rad, mount.parent)
