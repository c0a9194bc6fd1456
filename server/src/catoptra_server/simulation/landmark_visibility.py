"""Which landmarks a camera sees, by geometry alone: for training data, and to judge detectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import pixel_from_direction
from catoptra_server.frames.frame_request import CameraSpec, OmniCameraSpec, ViewRequest
from catoptra_server.sensors.sensor_environment import SensorEnvironment

# A beacon is drawn as a polygon, and rays are single precision.
_SURFACE_TOLERANCE_M = 0.01


@dataclass(frozen=True, slots=True)
class LandmarkVisibility:
    """A landmark, where the middle of its band lies in the picture, and whether it is seen there.

    pixel: (u, v), None outside the picture. visible: in the picture, and nothing stands between the
    effective viewpoint and the middle of the band but the landmark itself.
    """

    landmark: Landmark
    pixel: tuple[float, float] | None
    is_visible: bool


def compute_landmark_visibility(
    view_request: ViewRequest, landmarks: Sequence[Landmark], environment: SensorEnvironment
) -> tuple[LandmarkVisibility, ...]:
    """Return what is seen of each landmark through an eye where it is; robots hide as boxes."""
    if not landmarks:
        return ()
    pose = view_request.camera_state.world_from_mirror
    middles = np.array([(mark.x_m, mark.y_m, -mark.band_centre_m) for mark in landmarks])
    ways = middles - pose.translation
    pixels, inside = _project_directions(view_request.camera, ways @ pose.rotation)
    free = _has_line_of_sight(pose.translation, ways, landmarks, environment)
    return tuple(
        LandmarkVisibility(mark, (float(u), float(v)) if shown else None, bool(shown and reached))
        for mark, (u, v), shown, reached in zip(landmarks, pixels, inside, free, strict=True)
    )


def _project_directions(camera_spec: CameraSpec, directions: Floats) -> tuple[Floats, Bools]:
    """Return (n, 2) pixels of directions in the eye's frame, and which lie in its picture."""
    if not isinstance(camera_spec, OmniCameraSpec):
        return camera_spec.pixel_from_direction(directions)
    camera = camera_spec.camera
    pixels, valid = pixel_from_direction(camera, directions)
    u, v = pixels.T
    within = (u >= 0.0) & (u <= camera.width_px) & (v >= 0.0) & (v <= camera.height_px)
    return pixels, valid & within


def _has_line_of_sight(
    origin: Floats,
    displacements: Floats,
    landmarks: Sequence[Landmark],
    environment: SensorEnvironment,
) -> Bools:
    """Return which (n, 3) ways end before anything is met, a beacon's own surface aside."""
    lengths = np.linalg.norm(displacements, axis=1)
    directions = displacements / np.maximum(lengths, np.finfo(float).tiny)[:, None]
    met = environment.distances(origin, directions)
    free: Bools = met >= lengths - _self_occlusion_margin_m(landmarks, directions)
    return free


def _self_occlusion_margin_m(landmarks: Sequence[Landmark], directions: Floats) -> Floats:
    """Return (n,) how far unit ways run within a beacon before its middle: by its side or its end.

    The middle of a goal's mouth lies in the open.
    """
    sizes = [(m.width_m, m.band_top_m - m.band_bottom_m) for m in landmarks]
    halves = 0.5 * np.array(sizes) * [[mark.kind == "beacon"] for mark in landmarks]
    slopes = np.stack((np.linalg.norm(directions[:, :2], axis=1), abs(directions[:, 2])), axis=1)
    own: Floats = ((halves + _SURFACE_TOLERANCE_M) / np.maximum(slopes, 1e-9)).min(axis=1)
    return own
