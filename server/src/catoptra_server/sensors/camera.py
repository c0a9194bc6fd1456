"""What both kinds of camera on a robot offer to who shows their pictures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from catoptra_protocol.camera_conf import Pairs
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import CameraConfiguration, GeometryItem
from catoptra_server.frames.frame_request import ViewRequest
from catoptra_server.frames.multi_view import Tile
from catoptra_server.scene.dynamic_object import DynamicObject


class RobotCamera(Protocol):
    """A camera of a robot. tile: its place in a multi-view, where there is one."""

    name: str
    tile: Tile | None

    @property
    def type(self) -> str:
        """Return the type that it is asked for by."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Return width and height of its own picture."""

    @property
    def min_frame_interval_s(self) -> float:
        """Return the shortest time between two exposures; 0 = as fast as it can be drawn."""

    def robot_from_camera(self, joint_angles_rad: Mapping[str, float]) -> Pose:
        """Return where it is; `joints` are radians by lower-case link name."""

    def view_request(
        self,
        world_from_robot: Pose,
        objects: tuple[DynamicObject, ...] = (),
        *,
        joint_angles_rad: Mapping[str, float],
        tile: Tile | None = None,
    ) -> ViewRequest:
        """Return what it sees from a robot's pose, with the bodies of others; fitted to a tile."""

    def camera_model(self, tile: Tile | None = None) -> Pairs:
        """Return the camera law, enough to give every pixel its direction."""

    def configuration(self) -> CameraConfiguration:
        """Return the answer to GETCONF."""

    def geometry(self) -> GeometryItem:
        """Return the answer to GETGEO."""
