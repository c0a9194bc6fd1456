"""What a camera sees, by geometry alone: landmarks in view, and the thing at one point.

Labels for training and testing detectors, without a rendered frame. Other robots occlude as boxes;
the own one, whose box holds the camera, does not: the labels of a frame show it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.camera_rays import pixel_from_point, ray_from_pixel
from catoptra_protocol.optics.elementary import arctan2, hypot, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.frames.plan.camera import CameraSpec, OmniCameraSpec
from catoptra_server.frames.plan.error_bound import ErrorBound
from catoptra_server.simulation.sensors import RayCaster, SensorEnvironment
from catoptra_server.world.objects import OrientedBox, box_distances
from catoptra_server.world.scene_mesh import SceneMesh


@dataclass(frozen=True, slots=True)
class LandmarkVisibility:
    """Image position and visibility of a landmark."""

    landmark: Landmark
    pixel: tuple[float, float] | None
    """(u, v) of the centre of the landmark's band; None outside the image."""
    is_visible: bool
    """Whether the centre of the band lies in the image, and nothing but the landmark itself is
    between the viewpoint, or the mirror's point, and the centre."""


def compute_landmark_visibility(
    camera: CameraSpec,
    world_from_camera: Pose,
    landmarks: Sequence[Landmark],
    environment: SensorEnvironment,
) -> tuple[LandmarkVisibility, ...]:
    """Visibility of each landmark; robots occlude as boxes."""
    if not landmarks:
        return ()
    # z points down, and landmarks are given in heights above the floor.
    centres = np.array([(mark.x_m, mark.y_m, -mark.band_centre_m) for mark in landmarks])
    in_camera = matmul(centres - world_from_camera.translation, world_from_camera.rotation)
    pixels, inside = _project_points(camera, in_camera)
    origins = world_from_camera.transform_points(_find_origins(camera, pixels))
    free = _has_line_of_sight(origins, centres - origins, landmarks, environment)
    return tuple(
        LandmarkVisibility(
            mark, (float(u), float(v)) if is_inside else None, bool(is_inside and is_free)
        )
        for mark, (u, v), is_inside, is_free in zip(landmarks, pixels, inside, free, strict=True)
    )


@dataclass(frozen=True, slots=True)
class PixelView:
    """The ray through a point of an image, and the first thing on the way."""

    theta_rad: float | None = None
    """Angle to the optical axis; None outside the camera model's domain, as all below."""
    azimuth_rad: float | None = None
    """Azimuth in the camera frame, x towards y."""
    range_m: float | None = None
    """Distance along the ray, from the viewpoint, or from the mirror's point of a mirror without
    one; None if there is nothing."""
    object_name: str = ""
    """Name of the world's object, as of labels, or of the other robot; empty for none."""
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
        """Distance along a unit ray, inf if there is nothing, and the name of the thing."""
        origins, directions = origin[None], direction[None]
        distances, triangles = self.ray_caster.closest_triangles(origins, directions)
        nearest_m, name = float(distances[0]), ""
        if triangles[0] >= 0:
            name = self.scene.objects[self.scene.object_index[triangles[0]]].name
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
        # x along the axis of a pinhole camera, whose azimuth turns from right to down.
        origin = np.zeros(3)
        direction, is_valid = camera.camera.direction_from_pixel(pixel)
        along, right, down = direction[0], direction[1], direction[2]
    if not is_valid:
        return OUTSIDE
    theta_rad = arctan2(hypot(right, down), along)
    ray = matmul(world_from_camera.rotation, direction / hypot(*direction))
    range_m, name = things.find_first(world_from_camera.transform_points(origin), ray)
    return PixelView(
        theta_rad,
        arctan2(down, right),
        range_m if math.isfinite(range_m) else None,
        name,
        None if bound is None else bound.outline_error_at_px(_radius_fraction(camera, pixel)),
    )


# A beacon is drawn as a prism, not as a cylinder, and distances are single precision.
_SURFACE_TOLERANCE_M = 0.01


def _project_points(camera_spec: CameraSpec, points: Floats) -> tuple[Floats, Bools]:
    """Pixels (n, 2) of points in the camera frame, and whether each lies in the image."""
    if not isinstance(camera_spec, OmniCameraSpec):
        return camera_spec.camera.pixel_from_direction(points)
    camera = camera_spec.camera
    pixels, valid = pixel_from_point(camera, points)
    # The model's domain reaches to the mirror's rim, which may lie outside a cropped image.
    u, v = pixels.T
    within = (u >= 0.0) & (u <= camera.width_px) & (v >= 0.0) & (v <= camera.height_px)
    return pixels, valid & within


def _find_origins(camera_spec: CameraSpec, pixels: Floats) -> Floats:
    """Where the rays of (n, 2) pixels begin, (n, 3) in the camera frame."""
    if not isinstance(camera_spec, OmniCameraSpec):
        return np.zeros((len(pixels), 3))
    return ray_from_pixel(camera_spec.camera, pixels)[0]


def _has_line_of_sight(
    origins: Floats,
    displacements: Floats,
    landmarks: Sequence[Landmark],
    environment: SensorEnvironment,
) -> Bools:
    """Whether each (n, 3) displacement from an origin ends before the first surface, except the
    landmark's own.
    """
    lengths = np.linalg.norm(displacements, axis=1)
    # A camera inside a landmark's centre has no direction; tiny keeps the quotient finite.
    directions = displacements / np.maximum(lengths, np.finfo(float).tiny)[:, None]
    distances = environment.distances(origins, directions)
    free: Bools = distances >= lengths - _self_occlusion_margin_m(landmarks, directions)
    return free


def _self_occlusion_margin_m(landmarks: Sequence[Landmark], directions: Floats) -> Floats:
    """Lengths (n,) of the part of each unit ray inside a beacon, from surface to centre."""
    sizes = [(m.width_m, m.band_top_m - m.band_bottom_m) for m in landmarks]
    # 0 for goals: the centre of a goal's mouth lies in the open.
    half_sizes = 0.5 * np.array(sizes) * [[mark.kind == "beacon"] for mark in landmarks]
    # A ray enters a cylinder by the side or by an end, whichever is nearer to the centre: radius
    # over the level part of the direction, half height over the vertical part.
    slopes = np.stack((np.linalg.norm(directions[:, :2], axis=1), abs(directions[:, 2])), axis=1)
    margin: Floats = ((half_sizes + _SURFACE_TOLERANCE_M) / np.maximum(slopes, 1e-9)).min(axis=1)
    return margin


def _is_in_image(camera: CameraSpec, point_px: tuple[float, float]) -> bool:
    image = camera.camera
    u, v = point_px
    return 0.0 <= u <= image.width_px and 0.0 <= v <= image.height_px


def _radius_fraction(camera: CameraSpec, pixel: Floats) -> float:
    """Distance of a pixel from the image centre over the rim's."""
    if not isinstance(camera, OmniCameraSpec):
        return 0.0
    radius_px = float(hypot(*(pixel - camera.camera.centre_px)))
    return min(1.0, radius_px / camera.camera.rim_radius_px)
