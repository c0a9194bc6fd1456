"""An ordinary camera on a robot: what it is asked for, and its zoom. Renderers draw its picture."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from catoptra_protocol.camera_conf import Pairs, pairs_from_perspective_camera
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.configurations import TextureRegion as WireTile
from catoptra_protocol.usarsim.reports import CameraConfiguration, GeometryItem
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.frames.frame_request import ViewRequest
from catoptra_server.frames.multi_view import Tile
from catoptra_server.robot.robot_description import PerspectiveCameraDescription, RobotDescription
from catoptra_server.scene.dynamic_object import DynamicObject


class PerspectiveCameraSensor:
    """One robot's camera; it looks along x from where its mount carries it.

    tile: its place in a multi-view, where there is one.
    """

    type = "Camera"

    def __init__(self, description: PerspectiveCameraDescription, robot: RobotDescription) -> None:
        self.name = description.name
        self.description = description
        self.tile: Tile | None = None
        self._robot = robot
        self.fov_rad = description.fov_rad

    def zoom(self, fov_rad: float) -> float:
        """Take a field of view within the camera's limits, 0 for its default; return it."""
        is_ = self.description
        wished = fov_rad or is_.fov_rad
        self.fov_rad = min(max(wished, is_.min_fov_rad), is_.max_fov_rad)
        return self.fov_rad

    def robot_from_camera(self, joint_angles_rad: Mapping[str, float]) -> Pose:
        """Return where it is; `joints` are radians by lower-case link name."""
        mount = self.description.mount
        return (
            self._robot.robot_from_part(mount.parent, joint_angles_rad) @ mount.parent_from_item()
        )

    @property
    def size_px(self) -> tuple[int, int]:
        """Return width and height of its own picture."""
        return self.description.width_px, self.description.height_px

    @property
    def min_frame_interval_s(self) -> float:
        """Return 0: it is drawn as fast as it can be."""
        return 0.0

    def camera_for_tile(self, tile: Tile | None) -> PerspectiveCamera:
        """Return the camera at a tile's size; at its own without one."""
        width, height = (tile.width_px, tile.height_px) if tile else self.size_px
        return PerspectiveCamera(width, height, self.fov_rad)

    def view_request(
        self,
        world_from_robot: Pose,
        objects: tuple[DynamicObject, ...] = (),
        *,
        joint_angles_rad: Mapping[str, float],
        tile: Tile | None = None,
    ) -> ViewRequest:
        """Return what it sees from a robot's pose, with the bodies of others; fitted to a tile."""
        exposure = CameraState(world_from_robot @ self.robot_from_camera(joint_angles_rad), objects)
        return ViewRequest(self.camera_for_tile(tile), exposure)

    def camera_model(self, tile: Tile | None = None) -> Pairs:
        """Return the camera law, enough to give every pixel its direction."""
        return pairs_from_perspective_camera(self.camera_for_tile(tile))

    def configuration(self) -> CameraConfiguration:
        """Return its fields of view, and its tile if it has one."""
        is_ = self.description
        return CameraConfiguration(
            name=self.name,
            default_fov_deg=math.degrees(is_.fov_rad),
            min_fov_deg=math.degrees(is_.min_fov_rad),
            max_fov_deg=math.degrees(is_.max_fov_rad),
            fov_deg=math.degrees(self.fov_rad),
            texture_region=WireTile(*dataclasses.astuple(self.tile)) if self.tile else None,
        )

    def geometry(self) -> GeometryItem:
        """Return where it is mounted, and on what."""
        mount = self.description.mount
        return GeometryItem(self.name, mount.position_m, mount.rotation_rad, mount.parent)
