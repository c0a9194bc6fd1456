"""The omnidirectional camera on a robot: where it looks from, and its law. Others draw it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from catoptra_protocol.camera_conf import Pairs, pairs_from_omni_camera
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.configurations import TextureRegion as WireTile
from catoptra_protocol.usarsim.reports import CameraConfiguration, GeometryItem
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.frames.frame_request import OmniCameraSpec, ViewRequest
from catoptra_server.frames.multi_view import Tile, fit_omni_camera
from catoptra_server.robot.robot_description import OmniCameraDescription
from catoptra_server.scene.dynamic_object import DynamicObject


class OmniCameraSensor:
    """One robot's omnidirectional camera. tile: its place in a multi-view, where there is one."""

    type = "Camera"

    def __init__(self, description: OmniCameraDescription, *, viewpoint_height_m: float) -> None:
        self.name = description.name
        self.tile: Tile | None = None
        self._description = description
        self._viewpoint_height_m = viewpoint_height_m
        self._render_settings = description.render_settings

    @property
    def size_px(self) -> tuple[int, int]:
        """Return width and height of its own picture."""
        return self._description.camera.width_px, self._description.camera.height_px

    @property
    def min_frame_interval_s(self) -> float:
        """Return the shortest time between two exposures."""
        return self._description.min_frame_interval_s

    def robot_from_camera(self, joint_angles_rad: Mapping[str, float]) -> Pose:
        """Return where its effective viewpoint sits: on the chassis, whatever the joints do."""
        return self._description.robot_from_mirror

    def view_request(
        self,
        world_from_robot: Pose,
        objects: tuple[DynamicObject, ...] = (),
        *,
        joint_angles_rad: Mapping[str, float],
        tile: Tile | None = None,
    ) -> ViewRequest:
        """Return what it sees from a robot's pose, with the bodies of others; fitted to a tile."""
        exposure = CameraState(world_from_robot @ self._description.robot_from_mirror, objects)
        return ViewRequest(self.camera_spec(tile), exposure)

    def camera_spec(self, tile: Tile | None = None) -> OmniCameraSpec:
        """Return what is looked through; fitted to a tile."""
        return OmniCameraSpec(
            self.camera_for_tile(tile), self._render_settings, self._description.effects
        )

    def set_accuracy_target(
        self, *, max_error_px: float | None = None, budget_ms: float | None = None
    ) -> None:
        """Have its next pictures drawn to another tolerance or budget; None leaves one as it is.

        Raises DomainError for what is not 0 or more.
        """
        dial = self._render_settings.accuracy_target.with_changes(
            max_error_px=max_error_px, budget_ms=budget_ms
        )
        self._render_settings = dataclasses.replace(self._render_settings, accuracy_target=dial)

    def camera_for_tile(self, tile: Tile | None) -> OmniCamera:
        """Return the camera as it fills a tile; its own law without one."""
        camera = self._description.camera
        if tile is None or (tile.width_px, tile.height_px) == self.size_px:
            return camera
        return fit_omni_camera(tile, camera)

    @property
    def capture_fov_rad(self) -> float:
        """Return the capture camera's field of view over the mirror, which no SET changes."""
        return self._description.capture_fov_rad

    def camera_model(self, tile: Tile | None = None) -> Pairs:
        """Return the camera law, enough to give every pixel its direction."""
        return pairs_from_omni_camera(self.camera_for_tile(tile), self._viewpoint_height_m)

    def configuration(self) -> CameraConfiguration:
        """Return its fields of view, its tile if it has one, and the law there."""
        law = self.camera_model(self.tile)
        default, least, most, now = (float(value) for _, value in law[:4])
        tile = WireTile(*dataclasses.astuple(self.tile)) if self.tile else None
        return CameraConfiguration(self.name, default, least, most, now, tile, law[4:])

    def geometry(self) -> GeometryItem:
        """Return where the effective viewpoint sits on the chassis."""
        x, y, z = (float(value) for value in self._description.robot_from_mirror.translation)
        return GeometryItem(
            self.name, (x, y, z), self._description.robot_from_mirror.to_rpy(), "HARD"
        )
