"""The omnidirectional camera on a robot: where it looks from, and its law. Others draw it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from catoptra_protocol.camera_conf import Pairs, pairs_from_camera
from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.configurations import Tile as WireTile
from catoptra_protocol.wire.reports import CameraConfiguration, GeometryItem
from catoptra_server.imaging.multi_view import Tile, omni_camera_for
from catoptra_server.imaging.shot import OmniEye, Take
from catoptra_server.render.renderer import Exposure
from catoptra_server.robot.description import OmniCameraDescription
from catoptra_server.scene.bodies import Body


class OmniCameraSensor:
    """One robot's omnidirectional camera. tile: its place in a multi-view, where there is one."""

    type = "Camera"

    def __init__(self, description: OmniCameraDescription, *, viewpoint_height_m: float) -> None:
        self.name = description.name
        self.tile: Tile | None = None
        self._is = description
        self._viewpoint_height_m = viewpoint_height_m
        self._wish = description.wish

    @property
    def size_px(self) -> tuple[int, int]:
        """Return width and height of its own picture."""
        return self._is.camera.width_px, self._is.camera.height_px

    @property
    def frame_interval_s(self) -> float:
        """Return the shortest time between two exposures."""
        return self._is.frame_interval_s

    def robot_from_camera(self, joints: Mapping[str, float]) -> Pose:
        """Return where its effective viewpoint sits: on the chassis, whatever the joints do."""
        return self._is.robot_from_mirror

    def take(
        self,
        world_from_robot: Pose,
        bodies: tuple[Body, ...] = (),
        *,
        joints: Mapping[str, float],
        tile: Tile | None = None,
    ) -> Take:
        """Return what it sees from a robot's pose, with the bodies of others; fitted to a tile."""
        exposure = Exposure(world_from_robot @ self._is.robot_from_mirror, bodies)
        return Take(self.eye(tile), exposure)

    def eye(self, tile: Tile | None = None) -> OmniEye:
        """Return what is looked through; fitted to a tile."""
        return OmniEye(self.camera_in(tile), self._wish, self._is.effects)

    def turn_dial(
        self, *, max_error_px: float | None = None, budget_ms: float | None = None
    ) -> None:
        """Have its next pictures drawn to another tolerance or budget; None leaves one as it is.

        Raises DomainError for what is not 0 or more.
        """
        dial = self._wish.dial.turned(max_error_px=max_error_px, budget_ms=budget_ms)
        self._wish = dataclasses.replace(self._wish, dial=dial)

    def camera_in(self, tile: Tile | None) -> OmniCamera:
        """Return the camera as it fills a tile; its own law without one."""
        camera = self._is.camera
        if tile is None or (tile.width_px, tile.height_px) == self.size_px:
            return camera
        return omni_camera_for(tile, camera)

    @property
    def capture_fov_rad(self) -> float:
        """Return the capture camera's field of view over the mirror, which no SET changes."""
        return self._is.capture_fov_rad

    def law(self, tile: Tile | None = None) -> Pairs:
        """Return the camera law, enough to give every pixel its direction."""
        return pairs_from_camera(self.camera_in(tile), self._viewpoint_height_m)

    def configuration(self) -> CameraConfiguration:
        """Return its fields of view, its tile if it has one, and the law there."""
        law = self.law(self.tile)
        default, least, most, now = (float(value) for _, value in law[:4])
        tile = WireTile(*dataclasses.astuple(self.tile)) if self.tile else None
        return CameraConfiguration(self.name, default, least, most, now, tile, law[4:])

    def geometry(self) -> GeometryItem:
        """Return where the effective viewpoint sits on the chassis."""
        x, y, z = (float(value) for value in self._is.robot_from_mirror.translation)
        return GeometryItem(self.name, (x, y, z), self._is.robot_from_mirror.rpy(), "HARD")
