"""Robots and cameras as frames see them: protocols, so that nothing here imports the simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from catoptra_protocol.camera_conf import Pairs
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.frames.multi_view import Tile
from catoptra_server.frames.viewports import Viewports
from catoptra_server.planning.camera_spec import CameraSpec
from catoptra_server.world.camera_state import NoiseSeed
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.world_description import Twist


class RobotCamera(Protocol):
    """A camera that a robot carries, of either kind."""

    name: str
    # Assigned by `ImagePortLayout`, reported by the camera in CONF.
    tile: Tile | None
    """Tile of the camera in a multi-view; None without one."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the camera's own image."""

    @property
    def min_frame_interval_s(self) -> float:
        """Shortest simulation time between two exposures; 0 sets no limit."""

    def robot_from_camera(self, joint_angles_rad: Mapping[str, float]) -> Pose:
        """Pose of the effective viewpoint or pinhole, given joint angles by lower-case name."""

    def camera_spec(self, tile: Tile | None = None) -> CameraSpec:
        """Camera and render settings, fitted to a tile."""

    def camera_model(self, tile: Tile | None = None) -> Pairs:
        """Key-value pairs of the camera model at the size of a tile."""


class CameraRobot(Protocol):
    """A robot that carries cameras."""

    name: str
    number: int
    """Number among all robots that were ever spawned, from 1."""
    tile_index: int
    """Tile of the first camera in a multi-view, -1 without one."""
    viewports: Viewports

    @property
    def class_name(self) -> str:
        """Class of the robot with its package, such as USARBot.OmniP2AT."""

    @property
    def world_from_robot(self) -> Pose:
        """Pose of the chassis frame."""

    @property
    def twist(self) -> Twist:
        """Motion in the last tick, referred to the chassis origin, in world axes."""

    @property
    def joint_angles_rad(self) -> Mapping[str, float]:
        """Angle of each joint by lower-case link name."""

    @property
    def all_cameras(self) -> Sequence[RobotCamera]:
        """Cameras of the robot, the omnidirectional one first."""

    def find_camera(self, name: str) -> RobotCamera | None:
        """Camera of a name in any case; the first camera for an empty name."""

    def noise_seed_for(self, camera: str) -> NoiseSeed:
        """Seed of the image noise of a camera in this tick."""


@dataclass(frozen=True, slots=True, eq=False)
class VisibleObjects:
    """Dynamic objects that the cameras of one robot can show."""

    objects: tuple[DynamicObject, ...]
    """Other robots."""
    ego_body: DynamicObject | None = None
    """The robot itself, where a camera's effects include the view of the robot's own body."""


# A function: a robot that no camera of a frame belongs to is not looked up.
VisibleObjectsLookup = Callable[[CameraRobot], VisibleObjects]
