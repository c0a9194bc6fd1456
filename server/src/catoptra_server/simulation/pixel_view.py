"""What a camera sees at one point of its image: direction, range and name of the thing there."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from catoptra_protocol.optics.camera_rays import ray_from_pixel
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.planning.camera_spec import CameraSpec, OmniCameraSpec
from catoptra_server.planning.error_bound import ErrorBound
from catoptra_server.sensors.sensor_environment import RayCaster
from catoptra_server.world.objects import OrientedBox, box_distances
from catoptra_server.world.scene_mesh import SceneMesh


@dataclass(frozen=True, slots=True)
class PixelView:
    """The ray through a point of an image, and the first thing that it meets."""

    theta_rad: float | None = None
    """Angle to the optical axis; None outside the camera model's domain, as all below."""
    azimuth_rad: float | None = None
    """Azimuth in the camera frame, x towards y."""
    range_m: float | None = None
    """Distance along the ray, from the viewpoint, or from the mirror's point of a mirror without
    one; None if it meets nothing."""
    object_name: str = ""
    """Name of the world's item or of the robot; empty for none."""
    bound_px: float | None = None
    """Bound on the displacement of outlines at this point; None without a bound."""


OUTSIDE = PixelView()


@dataclass(frozen=True, slots=True, eq=False)
class NamedScene:
    """The things that a ray may meet, with their names."""

    scene: SceneMesh
    ray_caster: RayCaster
    robot_names: Sequence[str]
    robot_boxes: Sequence[OrientedBox]
    """Bounding boxes, in the order of the names."""

    def find_first(self, origin: Floats, direction: Floats) -> tuple[float, str]:
        """Distance along a unit ray, inf if it meets nothing, and the name of the thing."""
        origins, directions = origin[None], direction[None]
        distances, triangles = self.ray_caster.closest_triangles(origins, directions)
        nearest_m, name = float(distances[0]), ""
        if triangles[0] >= 0:
            name = self.scene.item_names[self.scene.item_index[triangles[0]]]
        for robot, box in zip(self.robot_names, self.robot_boxes, strict=True):
            robot_m = float(box_distances((box,), origins, directions)[0])
            if robot_m < nearest_m:
                nearest_m, name = robot_m, robot
        return nearest_m, name


def look_through_pixel(
    camera: CameraSpec,
    world_from_camera: Pose,
    point_px: tuple[float, float],
    things: NamedScene,
    bound: ErrorBound | None,
) -> PixelView:
    """View of the ray through a point of an image; OUTSIDE the camera model's domain.

    Args:
        camera: The camera.
        world_from_camera: Pose of the effective viewpoint or pinhole.
        point_px: (u, v), pixel centres at +0.5.
        things: Everything that the ray may meet.
        bound: Error bound of the camera's frames; None if unknown.
    """
    if not _is_in_image(camera, point_px):
        return OUTSIDE
    pixel = np.array(point_px)
    if isinstance(camera, OmniCameraSpec):
        origin, direction, is_valid = ray_from_pixel(camera.camera, pixel)
        along, right, down = direction[2], direction[0], direction[1]
    else:
        # x along the axis of a pinhole camera; its azimuth turns from right to down.
        origin = np.zeros(3)
        direction, is_valid = camera.camera.direction_from_pixel(pixel)
        along, right, down = direction[0], direction[1], direction[2]
    if not is_valid:
        return OUTSIDE
    theta_rad = math.atan2(math.hypot(right, down), along)
    ray = world_from_camera.rotation @ (direction / np.linalg.norm(direction))
    range_m, name = things.find_first(world_from_camera.transform_points(origin), ray)
    return PixelView(
        theta_rad,
        math.atan2(down, right),
        range_m if math.isfinite(range_m) else None,
        name,
        None if bound is None else bound.outline_error_at_px(_radius_fraction(camera, pixel)),
    )


def _is_in_image(camera: CameraSpec, point_px: tuple[float, float]) -> bool:
    image = camera.camera
    u, v = point_px
    return 0.0 <= u <= image.width_px and 0.0 <= v <= image.height_px


def _radius_fraction(camera: CameraSpec, pixel: Floats) -> float:
    """Distance of a pixel from the image centre over that of the rim."""
    if not isinstance(camera, OmniCameraSpec):
        return 0.0
    radius_px = float(np.hypot(*(pixel - camera.camera.centre_px)))
    return min(1.0, radius_px / camera.camera.rim_radius_px)
