"""Queries about what a camera sees: landmarks in view, and the view through a pixel."""

from __future__ import annotations

from collections.abc import Sequence

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.frame_request import CameraChannel
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.simulation.fleet_cameras import FleetCameras
from catoptra_server.simulation.fleet_environment import FleetEnvironment
from catoptra_server.simulation.get_commands import ErrorBoundLookup
from catoptra_server.simulation.landmark_visibility import (
    LandmarkVisibility,
    compute_landmark_visibility,
)
from catoptra_server.simulation.pixel_view import PixelView, look_through_pixel
from catoptra_server.simulation.robot import CameraSensor, Robot


class CameraQueries:
    """Queries about the cameras of a fleet. Only the simulation thread may call methods."""

    def __init__(
        self,
        cameras: FleetCameras,
        environment: FleetEnvironment,
        landmarks: Sequence[Landmark],
        error_bound_of: ErrorBoundLookup,
    ) -> None:
        """Create the queries.

        Args:
            cameras: Finds robot and camera of a channel.
            environment: What the cameras may see.
            landmarks: All landmarks of the world.
            error_bound_of: Error bound of a camera; None before the first frame.
        """
        self._cameras = cameras
        self._environment = environment
        self._landmarks = landmarks
        self._error_bound_of = error_bound_of

    def compute_landmark_visibility(
        self, channel: CameraChannel
    ) -> tuple[LandmarkVisibility, ...] | None:
        """Landmarks in view of a camera; None without such a robot or camera."""
        found = self._cameras.find(channel)
        if found is None:
            return None
        robot, camera = found
        return compute_landmark_visibility(
            camera.camera_spec(),
            _find_pose(robot, camera),
            self._landmarks,
            self._environment.sense(robot),
        )

    def look_through_pixel(
        self, channel: CameraChannel, point_px: tuple[float, float]
    ) -> PixelView | None:
        """What a camera sees at a point of its image; None without such a robot or camera."""
        found = self._cameras.find(channel)
        if found is None:
            return None
        robot, camera = found
        spec = camera.camera_spec()
        return look_through_pixel(
            spec,
            _find_pose(robot, camera),
            point_px,
            self._environment.name_things(robot),
            self._error_bound_of(spec) if isinstance(spec, OmniCameraSpec) else None,
        )


def _find_pose(robot: Robot, camera: CameraSensor) -> Pose:
    """world_from_camera at present."""
    return robot.world_from_robot @ camera.robot_from_camera(robot.joint_angles_rad)
