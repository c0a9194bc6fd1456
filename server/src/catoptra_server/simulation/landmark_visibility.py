"""Landmarks in view of a camera, by geometry alone: labels for training and testing detectors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.camera_rays import pixel_from_point, ray_from_pixel
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.planning.camera_spec import CameraSpec, OmniCameraSpec
from catoptra_server.sensors.sensor_environment import SensorEnvironment

# A beacon is drawn as a prism, not as a cylinder, and distances are single precision.
_SURFACE_TOLERANCE_M = 0.01


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
    in_camera = (centres - world_from_camera.translation) @ world_from_camera.rotation
    pixels, inside = _project_points(camera, in_camera)
    origins = world_from_camera.transform_points(_find_origins(camera, pixels))
    free = _has_line_of_sight(origins, centres - origins, landmarks, environment)
    return tuple(
        LandmarkVisibility(
            mark, (float(u), float(v)) if is_inside else None, bool(is_inside and is_free)
        )
        for mark, (u, v), is_inside, is_free in zip(landmarks, pixels, inside, free, strict=True)
    )


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
    """Lengths (n,) of the part of each unit ray inside a beacon, from its surface to its centre."""
    sizes = [(m.width_m, m.band_top_m - m.band_bottom_m) for m in landmarks]
    # 0 for goals: the centre of a goal's mouth lies in the open.
    half_sizes = 0.5 * np.array(sizes) * [[mark.kind == "beacon"] for mark in landmarks]
    # A ray enters a cylinder by the side or by an end, whichever is nearer to the centre: radius
    # over the level part of the direction, half height over the vertical part.
    slopes = np.stack((np.linalg.norm(directions[:, :2], axis=1), abs(directions[:, 2])), axis=1)
    margin: Floats = ((half_sizes + _SURFACE_TOLERANCE_M) / np.maximum(slopes, 1e-9)).min(axis=1)
    return margin
