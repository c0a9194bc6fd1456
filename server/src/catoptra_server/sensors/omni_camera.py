"""The omnidirectional camera on a robot: draws from where its viewpoint is, and tells its law."""

from __future__ import annotations

from catoptra_protocol.camera_conf import pairs_from_camera
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.reports import Configuration, GeometryItem
from catoptra_server.render.renderer import Exposure, RenderedImage, View
from catoptra_server.robot.description import OmniCameraDescription
from catoptra_server.scene.bodies import Body


class OmniCameraSensor:
    """One robot's omnidirectional camera; the view is shared by all robots of the class."""

    type = "Camera"

    def __init__(
        self, description: OmniCameraDescription, view: View, *, viewpoint_height_m: float
    ) -> None:
        self.name = description.name
        self._is = description
        self._view = view
        self._viewpoint_height_m = viewpoint_height_m

    def expose(self, world_from_robot: Pose, bodies: tuple[Body, ...] = ()) -> RenderedImage:
        """Return the picture from a robot's pose, with the bodies of others in it."""
        return self._view.draw(Exposure(world_from_robot @ self._is.robot_from_mirror, bodies))

    @property
    def capture_fov_rad(self) -> float:
        """Return the capture camera's field of view over the mirror, which no SET changes."""
        return self._is.capture_fov_rad

    def configuration(self) -> Configuration:
        """Return the camera law, enough to give every pixel its direction."""
        pairs = pairs_from_camera(self._is.camera, self._viewpoint_height_m)
        return Configuration(self.type, (("Name", self.name), *pairs))

    def geometry(self) -> GeometryItem:
        """Return where the effective viewpoint sits on the chassis."""
        x, y, z = (float(value) for value in self._is.robot_from_mirror.translation)
        return GeometryItem(self.name, (x, y, z), self._is.robot_from_mirror.rpy(), "HARD")
