"""The omnidirectional camera on a robot: pose, camera model and settings. Renderers draw it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from catoptra_protocol.camera_conf import Pairs, pairs_from_omni_camera
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import LENS_FROM_MIRROR, Pose
from catoptra_protocol.usarsim.configurations import TextureRegion
from catoptra_protocol.usarsim.reports import CameraConfiguration, GeometryItem
from catoptra_server.frames.multi_view import Tile, fit_omni_camera
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.simulation.robot_description import OmniCameraDescription, RobotDescription


class OmniCameraSensor:
    """Omnidirectional camera of one robot."""

    type = "Camera"

    def __init__(self, description: OmniCameraDescription, robot: RobotDescription) -> None:
        """Mount the camera on a robot."""
        self.name = description.name
        self.tile: Tile | None = None
        self._description = description
        self._robot = robot
        # Part of the published camera model.
        self._viewpoint_height_m = robot.viewpoint_height_m(description)
        self._render_settings = description.render_settings

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the camera's own image."""
        return self._description.camera.width_px, self._description.camera.height_px

    @property
    def min_frame_interval_s(self) -> float:
        """Shortest simulation time between two exposures."""
        return self._description.min_frame_interval_s

    def robot_from_camera(self, joint_angles_rad: Mapping[str, float]) -> Pose:
        """Pose of the effective viewpoint, given joint angles by lower-case link name."""
        return self._robot.robot_from_omni(self._description, joint_angles_rad)

    def camera_spec(self, tile: Tile | None = None) -> OmniCameraSpec:
        """Camera and render settings, fitted to a tile."""
        # Compared by value: equal cameras of several robots share one prepared view.
        camera = self.camera_for_tile(tile)
        return OmniCameraSpec(camera, self._render_settings, self._description.effects)

    def set_accuracy_target(
        self, *, max_error_px: float | None = None, budget_ms: float | None = None
    ) -> None:
        """Change the accuracy target of the next frames; None leaves a value unchanged.

        Raises:
            DomainError: A value is negative or not finite.
        """
        target = self._render_settings.accuracy_target.with_changes(
            max_error_px=max_error_px, budget_ms=budget_ms
        )
        self._render_settings = dataclasses.replace(self._render_settings, accuracy_target=target)

    def camera_for_tile(self, tile: Tile | None) -> OmniCamera:
        """Camera model at the size of a tile; at the camera's own size without one."""
        camera = self._description.camera
        # A tile of the camera's own size leaves the image's centre where the file puts it.
        if tile is None or (tile.width_px, tile.height_px) == self.size_px:
            return camera
        return fit_omni_camera(tile, camera)

    @property
    def capture_fov_rad(self) -> float:
        """Field of view of the capture camera over the mirror, which no SET changes."""
        return self._description.capture_fov_rad

    def camera_model(self, tile: Tile | None = None) -> Pairs:
        """Key-value pairs of the camera model, enough to compute the direction of every pixel."""
        # Cached by camera there: every frame carries the pairs, and formatting numbers takes time.
        return pairs_from_omni_camera(self.camera_for_tile(tile), self._viewpoint_height_m)

    def configuration(self) -> CameraConfiguration:
        """CONF: fields of view, tile and camera model there."""
        model = self.camera_model(self.tile)
        # The first four pairs are the fields of view, which USARSim has as fields of their own.
        default, minimum, maximum, present = (float(value) for _, value in model[:4])
        region = TextureRegion(*dataclasses.astuple(self.tile)) if self.tile else None
        return CameraConfiguration(self.name, default, minimum, maximum, present, region, model[4:])

    def geometry(self) -> GeometryItem:
        """GEO: pose of the effective viewpoint on its mount, of a lens with x along its axis."""
        pose = self._description.robot_from_mirror
        if not self._description.camera.has_mirror:
            pose = pose @ LENS_FROM_MIRROR.inverse()
        x, y, z = (float(value) for value in pose.translation)
        return GeometryItem(self.name, (x, y, z), pose.to_rpy(), self._description.parent)
