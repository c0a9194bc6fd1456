"""Cameras of a fleet: their tiles, the robot and camera of a channel, and its frames."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import assert_never

from catoptra_server.frames.frame_request import (
    CameraChannel,
    Channel,
    FrameComposition,
    ImagePortChannel,
)
from catoptra_server.frames.image_port_layout import (
    ImagePortLayout,
    compose_camera_frame,
    compose_variant,
    find_displayed_robot,
)
from catoptra_server.frames.multi_view import TileLayout
from catoptra_server.frames.robot_camera import CameraRobot, VisibleObjects
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.robot.robot_description import RobotDescription
from catoptra_server.simulation.robot import CameraSensor, Robot
from catoptra_server.simulation.robot_meshes import RobotMeshes
from catoptra_server.simulation.simulation_events import AccuracyTargetChanged

# Width and height of the black image of a server whose robots have no omnidirectional camera.
_DEFAULT_BLANK_SIZE_PX = (320, 240)


class FleetCameras:
    """Cameras of all robots. Only the simulation thread may call methods."""

    def __init__(
        self,
        robots: Collection[Robot],
        classes: Sequence[RobotDescription],
        multi_view: TileLayout | None,
    ) -> None:
        """Create the cameras of a fleet.

        Args:
            robots: Robots in the order of spawning; a view, in which robots come and go.
            classes: Classes that robots may have.
            multi_view: Tiles of the image port; None for the viewports of one robot.
        """
        self._robots = robots
        self._meshes = RobotMeshes(classes)
        self._layout = ImagePortLayout(multi_view, blank_size_px=_blank_size_px(classes))

    def assign_tiles(self, robot: Robot) -> None:
        """Assign free tiles to the cameras of a new robot."""
        self._layout.assign_tiles(robot)

    def release(self, robot: Robot) -> None:
        """Free the tiles of a robot that is removed."""
        self._layout.release(robot)

    def compose_frame(self, channel: Channel) -> FrameComposition | None:
        """Compose the frame of a channel; None without such a robot or camera."""
        match channel:
            case ImagePortChannel(tile):
                return self._layout.compose_frame(self._robots, self._visible_objects, tile=tile)
            case CameraChannel():
                found = self.find(channel)
                if found is None:
                    return None
                composition = compose_camera_frame(*found, self._visible_objects)
                variant = channel.variant
                return composition if variant is None else compose_variant(composition, variant)
            case _:
                assert_never(channel)

    def find(self, channel: CameraChannel) -> tuple[Robot, CameraSensor] | None:
        """Robot and camera of a channel; without a robot's name, of the displayed robot."""
        robot = self.find_robot(channel.robot)
        camera = robot.find_camera(channel.camera) if robot else None
        return (robot, camera) if robot and camera else None

    def find_robot(self, name: str) -> Robot | None:
        """Robot of an exact name; the displayed one for an empty name."""
        # Names of robots are unique with their case, as `unique_name` compares them.
        if name:
            return next((robot for robot in self._robots if robot.name == name), None)
        return find_displayed_robot(self._robots)

    def _visible_objects(self, robot: CameraRobot) -> VisibleObjects:
        others = [other for other in self._robots if other is not robot]
        return VisibleObjects(self._meshes.dynamic_objects(others), self._meshes.ego_body(robot))


def _blank_size_px(classes: Sequence[RobotDescription]) -> tuple[int, int]:
    """Width and height of the image port's image before the first robot."""
    # The size that the first robot will have: clients need not resize at the first INIT.
    cameras = [omni.camera for robot in classes for omni in robot.omni_cameras]
    return (cameras[0].width_px, cameras[0].height_px) if cameras else _DEFAULT_BLANK_SIZE_PX


def set_accuracy_target(
    robot: Robot | None, event: AccuracyTargetChanged
) -> tuple[OmniCameraSpec | None, str]:
    """Change the accuracy target of a robot's camera.

    Returns:
        The camera with the settings of the next frames, None without such a camera; and the name of
        the camera.
    """
    omnis = robot.omni_cameras if robot else []
    named = (omni for omni in omnis if event.camera.lower() in ("", omni.name.lower()))
    omni = next(named, None)
    if omni is None:
        return None, event.camera
    omni.set_accuracy_target(max_error_px=event.max_error_px, budget_ms=event.budget_ms)
    # As tiled: the plan depends on the size that the image port renders.
    return omni.camera_spec(omni.tile), omni.name
